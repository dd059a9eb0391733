// The versions of a map: which one serves, how good each is, how two compare, and changing it.

import { useSignal } from "@preact/signals";
import { mayBuild } from "../access/session";
import type { Schemas } from "../api/client";
import { versionPage } from "../api/maps";
import { useAnswerCounts } from "../maps/answerCounts";
import { MapProblem } from "../maps/MapProblem";
import { link, note, route } from "../router";
import { useLoaded } from "../ui/useLoaded";
import { ConfirmChange } from "./ConfirmChange";
import { type Change, callOf } from "./changeOf";
import { Comparison } from "./Comparison";
import { VersionRow } from "./VersionRow";

type Version = Schemas["VersionSummary"];
const LISTED = 20; // at first: the figures of each are read one by one

export function VersionsView({ map }: { map: string }) {
  const page = useLoaded((signal) => versionPage(map, signal), [map]);
  const compared = useSignal<string[]>(route.value.query.get("compare")?.split(",") ?? []);
  const isWhole = useSignal(false);
  const counts = useAnswerCounts().get(map);
  const asked = useSignal<Change | null>(null);
  const told = useSignal("");
  if (page.error) return <MapProblem map={map} error={page.error} again={page.again} />;
  if (!page.value) return <p role="status">Reading the versions …</p>;
  const all = page.value.versions;
  const areMany = all.length > 1;
  const chosen = compared.value.filter((one) => all.some(({ version }) => version === one));
  const toggle = (version: string) => {
    const on = chosen.includes(version);
    compared.value = on ? chosen.filter((one) => one !== version) : [...chosen, version].slice(-2);
    note({ compare: compared.value.join(",") });
  };
  const active = all.find((one) => one.active)?.version ?? "";
  const call = asked.value && callOf(map, asked.value, active);
  return (
    <main class="page">
      <header class="row">
        <h1>
          Versions of <a href={link(["maps", map])}>{map}</a>
        </h1>
        {mayBuild.value && areMany ? <button onClick={() => (asked.value = { kind: "rollback" })}>Roll back</button> : null}
        <span role="status">{told.value}</span>
      </header>
      <table class="cards">
        <thead>
          <tr>
            {areMany ? <th>Compare</th> : null}
            <th>Version</th>
            <th>Made of</th>
            <th class="number">Localized in its self-test</th>
            <th class="number">Sure and wrong</th>
            <th class="number">Threshold</th>
            <th>Sensor</th>
            <th>Published</th>
            <th>State</th>
            <th>
              <span class="unseen">Actions</span>
            </th>
          </tr>
        </thead>
        <tbody>
          {(isWhole.value ? all : all.slice(0, LISTED)).map((one) => (
            <VersionRow
              key={one.version}
              map={map}
              one={one}
              isCompared={chosen.includes(one.version)}
              compare={areMany ? () => toggle(one.version) : null}
              ask={(wanted) => (asked.value = wanted)}
            />
          ))}
        </tbody>
      </table>
      {all.length > LISTED && !isWhole.value ? (
        <button onClick={() => (isWhole.value = true)}>All {all.length} versions</button>
      ) : null}
      {call ? (
        <ConfirmChange
          call={call}
          done={(text) => {
            told.value = text;
            page.again();
          }}
          close={() => (asked.value = null)}
        >
          {call.isFelt && counts ? <p>In the last hour this replica answered {counts.hour.answered} queries of it.</p> : null}
        </ConfirmChange>
      ) : null}
      {chosen.length === 2 ? (
        <Comparison map={map} versions={chosen.map((one) => all.find(({ version }) => version === one)!) as [Version, Version]} />
      ) : areMany ? (
        <p class="hint">Choose two versions to compare them.</p>
      ) : null}
    </main>
  );
}
