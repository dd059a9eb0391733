import { percent } from "../ui/text";

/** Why the list is empty, and what to do. `share`: of the queries that are not localized, those that are recorded. */
export function NotRecorded({ share, isFiltered }: { share: number; isFiltered: boolean }) {
  if (isFiltered && share > 0) return <p>Choose another map, verdict or reason.</p>;
  if (share > 0) {
    return (
      <p>
        The service records {percent(share)} of the queries that it cannot localize, and there was none yet. They appear here
        as robots ask.
      </p>
    );
  }
  return (
    <p>
      Recording is off. Start the service with <code>FIRSTFIX_RECORDED_SHARE=1</code> to record the queries that it cannot
      localize.
    </p>
  );
}
