// What robots are told, as it happens: fixes on the map at the left; at the right who asks, and how many, how fast, how sure.

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Group } from "three";
import { lastAskedMap } from "../api/scans";
import { mapPage } from "../api/maps";
import { MapCanvas } from "../map3d/MapCanvas";
import { dotsMark, poseMark } from "../map3d/marks";
import { clear } from "../map3d/clear";
import type { MapScene } from "../map3d/scene";
import { go, route } from "../router";
import { Empty } from "../ui/Empty";
import { ErrorText } from "../ui/ErrorText";
import { useLoaded } from "../ui/useLoaded";
import { token } from "../ui/token";
import { colourOf } from "../ui/verdict";
import { Alerts } from "./Alerts";
import { LastAnswers } from "./LastAnswers";
import "./live.css";
import { Plots } from "./Plots";
import { Robots } from "./Robots";
import { alertsOf, robotsOf } from "./robotsOf";
import { seconds } from "./seconds";
import { useFixes } from "./useFixes";

export function LiveView() {
  const opened = useLoaded(async (signal) => {
    const [{ maps }, last] = await Promise.all([mapPage(signal), lastAskedMap(signal)]);
    return { maps, first: maps.find((one) => one.map_id === last) ?? maps[0] };
  }, []);
  const maps = opened.value?.maps ?? [];
  const map = route.value.query.get("map") || opened.value?.first?.map_id || "";
  const version = maps.find((one) => one.map_id === map)?.active_version ?? "";
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

  if (opened.error) return <ErrorText error={opened.error} again={opened.again} />;
  if (opened.value && !maps.length) {
    return (
      <Empty title="No map yet">
        <p>Build one, then robots can be followed in it.</p>
      </Empty>
    );
  }
  if (problem.value) return <ErrorText error={problem.value} />;
  const robots = robotsOf(fixes.value);
  const look = (position: readonly number[]) => scene.current?.lookAt(position);
  return (
    <main class="map-view live">
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
      ) : (
        <div class="map-canvas">{opened.value ? <p role="status">{map} has no active version to show.</p> : null}</div>
      )}
      <aside class="panel wide" aria-label="Robots and answers">
        <header class="row">
          <h1>Live</h1>
          <label>
            Map
            <select value={map} onChange={(event) => go(["live"], { map: event.currentTarget.value })}>
              {maps.map((one) => (
                <option key={one.map_id}>{one.map_id}</option>
              ))}
            </select>
          </label>
          <span role="status">{isConnected.value ? "Connected" : `Connecting again … ${trouble.value}`}</span>
        </header>
        {source.value ? (
          <small>
            {source.value.all_replicas
              ? "All replicas that share zenoh"
              : `Only replica ${source.value.replica}: others are seen where replicas share zenoh`}
          </small>
        ) : null}
        <Alerts map={map} ofRobots={alertsOf(robots, now.value)} now_s={now.value} />
        <Robots robots={robots} now_s={now.value} look={look} />
        {fixes.value.length ? (
          <>
            <Plots seconds={seconds(fixes.value, now.value)} />
            <LastAnswers fixes={fixes.value} look={look} />
          </>
        ) : (
          <Empty title="No query yet">
            <p>
              Answers appear here as robots ask. Try one yourself: <a href={`#/maps/${map}/try`}>try a scan</a>.
            </p>
          </Empty>
        )}
      </aside>
    </main>
  );
}
