// One answer in words: the verdict, why, what helps, and every place that was considered.

import { useSignal } from "@preact/signals";
import type { Schemas } from "../api/client";
import { chance } from "../ui/text";
import { Verdict } from "../ui/Verdict";
import { HintText } from "./HintText";
import { Places } from "./Places";
import { whyOf } from "./why";

export interface AnswerPanelProps {
  answer: Schemas["Answer"];
  least: number; // the probability that was asked for
  guide: string; // what the search was told beforehand; "": nothing
  chosen: number;
  choose: (hypothesis: number) => void;
}

export function AnswerPanel({ answer, least, guide, chosen, choose }: AnswerPanelProps) {
  const findings = answer.findings ?? []; // an answer that an older service recorded has none
  const isBelow = answer.reasons.length === 1 && answer.reasons[0] === "low_probability" && answer.probability < least;
  return (
    <section class="answer" aria-label="Answer">
      <p>
        <Verdict verdict={answer.verdict} /> {guide ? <span class="tag">{guide}</span> : null}
      </p>
      {whyOf(answer, least).map((text) => (
        <p key={text}>{text}</p>
      ))}
      {answer.verdict === "localized" ? null : <h3>What would make it localized</h3>}
      {isBelow ? <p>A least probability below its {chance(answer.probability)}, if your robots can bear more wrong answers.</p> : null}
      {findings.length ? (
        <ul class="findings" aria-label="Findings">
          {findings.map((one) => (
            <li key={one.code}>
              {one.text} <small>{one.remedy}</small>
            </li>
          ))}
        </ul>
      ) : null}
      {answer.hint ? <HintText hint={answer.hint} /> : null}
      {answer.hypotheses.length ? <Places answer={answer} chosen={chosen} choose={choose} /> : null}
      <Timings answer={answer} />
    </section>
  );
}

function Timings({ answer }: { answer: Schemas["Answer"] }) {
  const isShown = useSignal(false);
  const timings = Object.entries(answer.timings_ms ?? {});
  if (!timings.length) return null;
  const all = timings.reduce((sum, [, ms]) => sum + ms, 0);
  return (
    <details open={isShown.value} onToggle={(event) => (isShown.value = event.currentTarget.open)}>
      <summary>{all.toFixed(1)} milliseconds</summary>
      <dl class="timings">
        {timings.map(([stage, ms]) => (
          <div key={stage}>
            <dt>{stage.replaceAll("_", " ")}</dt>
            <dd>{ms.toFixed(1)}</dd>
          </div>
        ))}
      </dl>
    </details>
  );
}
