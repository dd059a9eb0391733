import { useSignal } from "@preact/signals";
import { buildLog } from "../api/builds";
import { Problem } from "../api/client";
import { pause } from "../api/patience";
import { ErrorText } from "../ui/ErrorText";
import { useLoaded } from "../ui/useLoaded";

const LOOK_MS = 2000; // from one look for a log to the next
const LOOKS = 15; // until it says that there is none

/** The end of the log of a build's processes, for admins. It is read when it is looked at. */
export function BuildLog({ build }: { build: string }) {
  const isOpen = useSignal(false);
  return (
    <details onToggle={(event) => (isOpen.value = event.currentTarget.open)}>
      <summary>Log</summary>
      {isOpen.value ? <Lines build={build} /> : null}
    </details>
  );
}

/** The log, which is kept as the processes end: a build that has just failed has none yet. */
async function keptLog(build: string, signal: AbortSignal): Promise<string> {
  for (let looks = 1; ; looks++) {
    try {
      return await buildLog(build, signal);
    } catch (error) {
      if (!(error instanceof Problem && error.status === 404) || looks === LOOKS) throw error;
      await pause(LOOK_MS, signal);
    }
  }
}

function Lines({ build }: { build: string }) {
  const log = useLoaded((signal) => keptLog(build, signal), [build]);
  if (log.error) return <ErrorText error={log.error} again={log.again} />;
  if (log.value === null) return <p role="status">Reading the log …</p>;
  return (
    <pre class="code" tabIndex={0} aria-label="Log of the build">
      {log.value || "It wrote nothing."}
    </pre>
  );
}
