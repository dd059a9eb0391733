import { percent } from "../ui/text";

/** Why the list is empty, and what to do. `share`: of the queries that are not localized, those that are kept. */
export function NotKept({ share, isFiltered }: { share: number; isFiltered: boolean }) {
  if (isFiltered && share > 0) return <p>Choose another map, verdict or reason.</p>;
  if (share > 0) {
    return (
      <p>
        The service keeps {percent(share)} of the queries that it cannot localize, and there was none yet. They appear here
        as robots ask.
      </p>
    );
  }
  return (
    <p>
      Keeping is off. Start the service with <code>FIRSTFIX_SAMPLES_SHARE=1</code> to keep the queries that it cannot
      localize.
    </p>
  );
}
