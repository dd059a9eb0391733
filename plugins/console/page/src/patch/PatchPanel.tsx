// What a patch has changed, who saw it, how the map does where nothing has changed, and what can be done with it.

import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { mayBuild } from "../access/session";
import type { Patch, PatchedArea } from "../maps/manifest";
import { link } from "../router";
import { count, short } from "../ui/text";
import { ConfirmChange } from "../versions/ConfirmChange";
import { type Change, callOf } from "../versions/changeOf";

export interface PatchPanelProps {
  map: string;
  version: string;
  active: string; // version; "": none
  patch: Patch;
  shown: number; // area, from 1; 0: there is none
  choose: (area: number) => void;
  counts: { added: number; removed: number } | null; // points of the area; null: not known
  again: () => void; // reads which version is active
  children: ComponentChildren;
}

export function PatchPanel({ map, version, active, patch, shown, choose, counts, again, children }: PatchPanelProps) {
  const asked = useSignal<Change | null>(null);
  const told = useSignal("");
  const isActive = version === active;
  const call = asked.value && callOf(map, asked.value, active);
  return (
    <aside class="panel" aria-label="The patch">
      <h1>
        Patch of <a href={link(["maps", map])}>{map}</a>
      </h1>
      <p class="is-it-good">
        <span class={isActive ? "tag on" : "tag"}>{isActive ? "active" : "waits for somebody to activate it"}</span>{" "}
        <a href={link(["maps", map], { version })}>
          <code>{short(version)}</code>
        </a>
        , made of{" "}
        <a href={link(["maps", map], { version: patch.base })}>
          <code>{short(patch.base)}</code>
        </a>
        .
      </p>
      {isActive || patch.base === active ? null : (
        <p class="hint">Another version than {short(patch.base)} is active by now: the patch is of an older map.</p>
      )}
      {mayBuild.value ? (
        <div class="row">
          {isActive ? (
            <button onClick={() => (asked.value = { kind: "rollback" })}>Roll back</button>
          ) : (
            <button onClick={() => (asked.value = { kind: "activate", version })}>Activate</button>
          )}
          <span role="status">{told.value}</span>
        </div>
      ) : null}
      {children}
      <section aria-label="Changed areas">
        <h3>What has changed</h3>
        <p class="hint">The largest first. The outline in the pictures is the chosen area.</p>
        <ol class="spots">
          {patch.areas.map((one, i) => (
            <li key={i}>
              <button aria-pressed={i + 1 === shown} onClick={() => choose(i + 1)}>
                {one.kind}, {extentOf(one)} m
              </button>{" "}
              {numbered(one.robots, "robot")} saw it, on {numbered(one.days, "day")}
            </li>
          ))}
        </ol>
        <ul class="key" aria-label="Colours of the points">
          <li class="gone">removed{counts ? `: ${numbered(counts.removed, "point")}` : ""}</li>
          <li class="new">added{counts ? `: ${numbered(counts.added, "point")}` : ""}</li>
        </ul>
      </section>
      <section aria-label="Who saw it">
        <h3>Who saw it</h3>
        <dl class="facts">
          <Fact name="Queries" value={count(patch.queries)} />
          <Fact name="Robots that asked them" value={count(patch.robots)} />
          <Fact name="Left out: told before" value={count(patch.replayed)} />
          <Fact name="Left out: at a doubtful pose" value={count(patch.doubtful)} />
        </dl>
      </section>
      <Unchanged patch={patch} />
      {call ? (
        <ConfirmChange
          call={call}
          done={(text) => {
            told.value = text;
            again();
          }}
          close={() => (asked.value = null)}
        />
      ) : null}
    </aside>
  );
}

/** The same scans asked of both versions where nothing has changed. */
function Unchanged({ patch: { compared } }: { patch: Patch }) {
  const rows: [string, number, number][] = [
    ["Localized", compared.localized_before, compared.localized_after],
    ["At a wrong place", compared.wrong_before, compared.wrong_after],
  ];
  return (
    <section aria-label="Where nothing has changed">
      <h3>Where nothing has changed</h3>
      <p class="hint">
        Both versions were asked the same {numbered(compared.places, "scan")} from such places: {count(compared.won)} only
        the patch localizes, {count(compared.lost)} only the version before.
      </p>
      <table>
        <thead>
          <tr>
            <th>Self-test</th>
            <th class="number">Before</th>
            <th class="number">After</th>
          </tr>
        </thead>
        <tbody>
          {rows.map(([name, before, after]) => (
            <tr key={name}>
              <th scope="row">{name}</th>
              <td class="number">{count(before)}</td>
              <td class="number">{count(after)}</td>
            </tr>
          ))}
        </tbody>
      </table>
    </section>
  );
}

function Fact({ name, value }: { name: string; value: string }) {
  return (
    <div>
      <dt>{name}</dt>
      <dd>{value}</dd>
    </div>
  );
}

function extentOf({ low_m, high_m }: PatchedArea): string {
  return low_m.map((low, axis) => (high_m[axis]! - low).toFixed(1)).join(" × ");
}

function numbered(n: number, what: string): string {
  return `${count(n)} ${what}${n === 1 ? "" : "s"}`;
}
