// One answer in words: the verdict, why, and every place that was considered.

import type { Schemas } from "../api/client";
import { metres, percent, reason } from "../ui/text";
import { Verdict } from "../ui/Verdict";

export interface AnswerPanelProps {
  answer: Schemas["Answer"];
  chosen: number;
  choose: (hypothesis: number) => void;
}

export function AnswerPanel({ answer, chosen, choose }: AnswerPanelProps) {
  const findings = answer.findings ?? []; // an answer that was kept by an older service has none
  const timings = Object.entries(answer.timings_ms ?? {});
  return (
    <section class="answer" aria-label="Answer">
      <p>
        <Verdict verdict={answer.verdict} /> with probability <strong>{percent(answer.probability, 1)}</strong>
      </p>
      {answer.reasons.map((code) => (
        <p key={code}>{reason(code)}</p>
      ))}
      {findings.length ? (
        <ul class="findings" aria-label="Findings">
          {findings.map((one) => (
            <li key={one.code}>
              {one.text} <small>{one.remedy}</small>
            </li>
          ))}
        </ul>
      ) : null}
      <h3>Places</h3>
      <ol class="hypotheses">
        {answer.hypotheses.map((one, i) => (
          <li key={i}>
            <button aria-pressed={i === chosen} onClick={() => choose(i)}>
              <strong>{percent(one.probability, 1)}</strong> at {one.T_map_sensor.position.map(metres).join(", ")}
              <small>
                {percent(one.inlier_ratio ?? 0)} on the map, {percent(one.free_space_violation ?? 0, 1)} through it
              </small>
            </button>
          </li>
        ))}
      </ol>
      {timings.length ? (
        <>
          <h3>Milliseconds</h3>
          <dl class="timings">
            {timings.map(([stage, ms]) => (
              <div key={stage}>
                <dt>{stage.replaceAll("_", " ")}</dt>
                <dd>{Number(ms).toFixed(1)}</dd>
              </div>
            ))}
          </dl>
        </>
      ) : null}
    </section>
  );
}
