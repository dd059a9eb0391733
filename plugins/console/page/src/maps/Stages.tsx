// The stages of a build with their times, as the build records each of them when it ends.

import { useSignal } from "@preact/signals";
import { useRef } from "preact/hooks";
import { buildDetails } from "../api/builds";
import type { Schemas } from "../api/client";
import { ErrorText } from "../ui/ErrorText";
import { duration } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";

type Build = Schemas["Build"];

/** Of a build that runs: those that have ended, and the one that goes on. */
export function GoingStages({ build: { build_id, stage }, now_ms }: { build: Build; now_ms: number }) {
  const details = useLoaded((signal) => buildDetails(build_id, signal), [build_id, stage]);
  const begun = useRef<{ stage: string; ms: number | null }>({ stage, ms: null }); // null: before somebody looked
  if (begun.current.stage !== stage) begun.current = { stage, ms: now_ms };
  const { ms } = begun.current;
  const ended = (details.value?.stages ?? []).filter((one) => one.stage !== stage);
  return (
    <ol class="stages" aria-label="Stages">
      {ended.map((one) => (
        <li key={one.stage}>
          {nameOf(one.stage)} <small>{one.cached ? "reused" : duration(one.seconds)}</small>
        </li>
      ))}
      <li aria-current="step">
        {nameOf(stage)} {ms === null ? null : <small>{duration((now_ms - ms) / 1000)}</small>}
      </li>
    </ol>
  );
}

/** Of a build that has ended. They are read when they are looked at. */
export function EndedStages({ build }: { build: string }) {
  const isOpen = useSignal(false);
  return (
    <details class="ended-stages" onToggle={(event) => (isOpen.value = event.currentTarget.open)}>
      <summary>Stages</summary>
      {isOpen.value ? <Recorded build={build} /> : null}
    </details>
  );
}

function Recorded({ build }: { build: string }) {
  const details = useLoaded((signal) => buildDetails(build, signal), [build]);
  if (details.error) return <ErrorText error={details.error} again={details.again} />;
  if (!details.value) return <p role="status">Reading the stages …</p>;
  const { stages, file_name, note } = details.value;
  return (
    <>
      {file_name || note ? (
        <p class="hint">
          {file_name ? `Of ${file_name}. ` : ""}
          {note}
        </p>
      ) : null}
      {stages.length ? null : <p class="hint">It recorded none.</p>}
      <dl class="facts">
        {stages.map((one) => (
          <div key={one.stage}>
            <dt>{nameOf(one.stage)}</dt>
            <dd>{one.cached ? "made by an earlier build" : duration(one.seconds)}</dd>
          </div>
        ))}
        {stages.length ? (
          <div>
            <dt>together</dt>
            <dd>{duration(stages.reduce((sum, one) => sum + one.seconds, 0))}</dd>
          </div>
        ) : null}
      </dl>
    </>
  );
}

/** A stage in words. */
export function nameOf(stage: string): string {
  return stage.replaceAll("_", " ");
}
