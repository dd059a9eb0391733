import { versionDetails } from "../api/maps";
import { ErrorText } from "../ui/ErrorText";
import { useLoaded } from "../ui/useLoaded";
import { changesOf } from "./changes";

/** Every setting and figure that differs between two versions. */
export function Changed({ map, versions }: { map: string; versions: [string, string] }) {
  const details = useLoaded(
    (signal) => Promise.all(versions.map((one) => versionDetails(map, one, signal))),
    [map, ...versions],
  );
  if (details.error) return <ErrorText error={details.error} again={details.again} />;
  if (!details.value) return null;
  const [before, after] = details.value.map((one) => one.manifest);
  const changes = changesOf(before!, after!);
  return (
    <>
      <h3>What changed</h3>
      {changes.length ? (
        <table>
          <thead>
            <tr>
              <th>Value</th>
              <th>First</th>
              <th>Second</th>
            </tr>
          </thead>
          <tbody>
            {changes.map((one) => (
              <tr key={one.name}>
                <th scope="row">{one.name}</th>
                <td>{one.before}</td>
                <td>{one.after}</td>
              </tr>
            ))}
          </tbody>
        </table>
      ) : (
        <p class="hint">They were made from the same source with the same settings.</p>
      )}
    </>
  );
}
