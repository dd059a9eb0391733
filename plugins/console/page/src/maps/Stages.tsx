// The stages of a build with their times: as they are seen while it runs, and as it recorded them once it has ended.

import { useSignal } from "@preact/signals";
import { buildDetails } from "../api/builds";
import { ErrorText } from "../ui/ErrorText";
import { duration } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";
import type { StageTime } from "./stageTimes";

export function GoingStages({ times }: { times: StageTime[] }) {
  if (!times.length) return null;
  return (
    <details class="stages">
      <summary>Stages</summary>
      <dl class="facts">
        {times.map(({ stage, seconds, isGoing }) => (
          <div key={stage}>
            <dt>{stage.replaceAll("_", " ")}</dt>
            <dd>{seconds === null ? "begun before this page" : `${duration(seconds)}${isGoing ? " so far" : ""}`}</dd>
          </div>
        ))}
      </dl>
    </details>
  );
}

/** Of a build that has ended. They are read when they are looked at. */
export function EndedStages({ build }: { build: string }) {
  const isOpen = useSignal(false);
  return (
    <details class="stages" onToggle={(event) => (isOpen.value = event.currentTarget.open)}>
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
      <p class="hint">
        {file_name ? `Of ${file_name}. ` : ""}
        {note}
      </p>
      {stages.length ? null : <p class="hint">It recorded none.</p>}
      <dl class="facts">
        {stages.map((one) => (
          <div key={one.stage}>
            <dt>{one.stage.replaceAll("_", " ")}</dt>
            <dd>{one.cached ? "made by an earlier build" : duration(one.seconds)}</dd>
          </div>
        ))}
      </dl>
    </>
  );
}
