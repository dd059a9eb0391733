// The versions of a map: which one serves, how two compare, and changing it.

import { useSignal } from "@preact/signals";
import { mayAdminister, mayBuild } from "../access/session";
import { change, get, type Schemas } from "../api/client";
import { link } from "../router";
import { ErrorText } from "../ui/ErrorText";
import { age, short } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";
import { Comparison } from "./Comparison";

export function VersionsView({ map }: { map: string }) {
  const page = useLoaded(
    (signal) => get<Schemas["VersionPage"]>(`/maps/${map}/versions`, { limit: 1000 }, signal),
    [map],
  );
  const compared = useSignal<string[]>([]);
  const problem = useSignal<unknown>(null);
  const told = useSignal("");
  const act = async (method: string, path: string, text: string) => {
    problem.value = null;
    try {
      await change(method, `/maps/${map}${path}`);
      told.value = text;
      page.again();
    } catch (error) {
      problem.value = error;
    }
  };
  if (page.error) return <ErrorText error={page.error} again={page.again} />;
  if (!page.value) return <p role="status">Reading the versions …</p>;
  const chosen = compared.value.filter((one) => page.value!.versions.some(({ version }) => version === one));
  const toggle = (version: string) => {
    const on = chosen.includes(version);
    compared.value = on ? chosen.filter((one) => one !== version) : [...chosen, version].slice(-2);
  };
  return (
    <main class="page">
      <header class="row">
        <h1>
          Versions of <a href={link(["maps", map])}>{map}</a>
        </h1>
        {mayBuild.value && page.value.versions.length > 1 ? (
          <button onClick={() => act("POST", "/rollback", "Rolled back")}>Roll back</button>
        ) : null}
        <span role="status">{told.value}</span>
      </header>
      {problem.value ? <ErrorText error={problem.value} /> : null}
      <table>
        <thead>
          <tr>
            <th>Compare</th>
            <th>Version</th>
            <th>Published</th>
            <th>State</th>
            <th />
          </tr>
        </thead>
        <tbody>
          {page.value.versions.map((one) => (
            <tr key={one.version}>
              <td>
                <input
                  type="checkbox"
                  aria-label={`Compare ${short(one.version)}`}
                  checked={chosen.includes(one.version)}
                  onChange={() => toggle(one.version)}
                />
              </td>
              <td>
                <a href={link(["maps", map], { version: one.version })}>
                  <code>{short(one.version)}</code>
                </a>
              </td>
              <td title={one.published_time}>{age(one.published_time)}</td>
              <td>
                {one.active ? <span class="tag on">active</span> : null}
                {one.provisional ? <span class="tag">provisional</span> : null}
              </td>
              <td class="actions">
                {mayBuild.value && !one.active ? (
                  <button onClick={() => act("POST", `/versions/${one.version}/activate`, "Activated")}>Activate</button>
                ) : null}
                {mayAdminister.value && !one.active ? (
                  <button onClick={() => act("DELETE", `/versions/${one.version}`, "Retired")}>Retire</button>
                ) : null}
              </td>
            </tr>
          ))}
        </tbody>
      </table>
      {chosen.length === 2 ? (
        <Comparison map={map} versions={chosen as [string, string]} />
      ) : (
        <p class="hint">Choose two versions to compare them.</p>
      )}
    </main>
  );
}
