import { useSignal } from "@preact/signals";
import { buildLog } from "../api/builds";
import { ErrorText } from "../ui/ErrorText";
import { useLoaded } from "../ui/useLoaded";

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

function Lines({ build }: { build: string }) {
  const log = useLoaded((signal) => buildLog(build, signal), [build]);
  if (log.error) return <ErrorText error={log.error} again={log.again} />;
  if (log.value === null) return <p role="status">Reading the log …</p>;
  return (
    <pre class="code" tabIndex={0} aria-label="Log of the build">
      {log.value || "It wrote nothing."}
    </pre>
  );
}
