// What robots are told, as it happens: fixes on the map, and how many, how fast, how sure.

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Group } from "three";
import { mapPage } from "../api/maps";
import { MapCanvas } from "../map3d/MapCanvas";
import { dotsMark, poseMark } from "../map3d/marks";
import { clear } from "../map3d/clear";
import type { MapScene } from "../map3d/scene";
import { go, route } from "../router";
import { Empty } from "../ui/Empty";
import { ErrorText } from "../ui/ErrorText";
import { chance } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";
import { token } from "../ui/token";
import { colourOf } from "../ui/verdict";
import { Verdict } from "../ui/Verdict";
import { Alerts } from "./Alerts";
import "./live.css";
import { Plots } from "./Plots";
import { Robots } from "./Robots";
import { alertsOf, robotsOf } from "./robotsOf";
import { type Second, seconds } from "./seconds";
import { useFixes } from "./useFixes";

const SHOWN_ROWS = 30;

export function LiveView() {
  const maps = useLoaded(mapPage, []);
  const map = route.value.query.get("map") || maps.value?.maps[0]?.map_id || "";
  const version = maps.value?.maps.find((one) => one.map_id === map)?.active_version ?? "";
  const { fixes, source, isConnected, trouble, problem } = useFixes(map);
  const now = useSignal(Date.now() / 1000);
  const scene = useRef<MapScene | null>(null);
  const marks = useRef(new Group());
  const isReady = useSignal(0);

  useEffect(() => {
    const clock = setInterval(() => (now.value = Date.now() / 1000), 1000);
    return () => clearInterval(clock);
  }, []);

  useEffect(() => {
    const here = scene.current;
    if (!here) return;
    clear(marks.current);
    const places = fixes.value.flatMap(({ answer }) =>
      answer.T_map_sensor ? here.local(answer.T_map_sensor.position).toArray() : [],
    );
    if (places.length) marks.current.add(dotsMark(new Float32Array(places), token("mark-fix"), 5));
    for (const { lastFix: fix } of robotsOf(fixes.value)) {
      if (!fix) continue;
      const pose = fix.answer.T_map_sensor!;
      marks.current.add(poseMark(here.local(pose.position), pose, colourOf(fix.answer.verdict), here.markSize));
    }
    here.redraw();
  }, [fixes.value, isReady.value]);

  if (maps.value && !maps.value.maps.length) {
    return (
      <Empty title="No map yet">
        <p>Build one, then robots can be followed in it.</p>
      </Empty>
    );
  }
  if (problem.value) return <ErrorText error={problem.value} />;
  const robots = robotsOf(fixes.value);
  const history: Second[] = seconds(fixes.value, now.value);
  return (
    <main class="live">
      <header class="row">
        <h1>Live</h1>
        <label>
          Map
          <select value={map} onChange={(event) => go(["live"], { map: event.currentTarget.value })}>
            {(maps.value?.maps ?? []).map((one) => (
              <option key={one.map_id}>{one.map_id}</option>
            ))}
          </select>
        </label>
        <span role="status">{isConnected.value ? "Connected" : `Connecting again … ${trouble.value}`}</span>
        {source.value ? (
          <span class="hint">
            {source.value.all_replicas
              ? "All replicas that share zenoh"
              : `Only replica ${source.value.replica}: others are seen where replicas share zenoh`}
          </span>
        ) : null}
      </header>
      <Alerts map={map} ofRobots={alertsOf(robots, now.value)} now_s={now.value} />
      <Robots
        robots={robots}
        now_s={now.value}
        look={(position) => scene.current?.lookAt(position)}
      />
      <Plots seconds={history} />
      {version ? (
        <MapCanvas
          key={version}
          map={map}
          version={version}
          ready={(found) => {
            scene.current = found;
            found?.overlay.add(marks.current);
            if (found) found.material.colouring = "plain"; // verdicts have the colours here
            isReady.value += 1;
          }}
        />
      ) : null}
      {fixes.value.length ? (
        <table class="fixes cards">
          <thead>
            <tr>
              <th>Time</th>
              <th>Caller</th>
              <th>Replica</th>
              <th>Verdict</th>
              <th class="number">Probability</th>
              <th class="number">ms</th>
            </tr>
          </thead>
          <tbody>
            {fixes.value
              .slice(-SHOWN_ROWS)
              .reverse()
              .map((fix) => (
                <tr
                  key={fix.number}
                  onClick={() => fix.answer.T_map_sensor && scene.current?.lookAt(fix.answer.T_map_sensor.position)}
                >
                  <td data-name="Time">{new Date(fix.time_s * 1000).toLocaleTimeString("en-GB")}</td>
                  <td data-name="Caller">{fix.caller}</td>
                  <td data-name="Replica">{fix.replica}</td>
                  <td data-name="Verdict">
                    <Verdict verdict={fix.answer.verdict} />
                  </td>
                  <td class="number" data-name="Probability">{chance(fix.answer.probability)}</td>
                  <td class="number" data-name="ms">{fix.ms.toFixed(0)}</td>
                </tr>
              ))}
          </tbody>
        </table>
      ) : (
        <Empty title="No query yet">
          <p>
            Answers appear here as robots ask. Try one yourself: <a href={`#/maps/${map}/try`}>try a scan</a>.
          </p>
        </Empty>
      )}
    </main>
  );
}
