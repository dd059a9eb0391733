// Try a scan: where does the service say it was taken, and does that look right?

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Group } from "three";
import { mayBuild } from "../access/session";
import { get, type Query, type Schemas, send } from "../api/client";
import { MapCanvas } from "../map3d/MapCanvas";
import { poseMark } from "../map3d/marks";
import { clear, type MapScene } from "../map3d/scene";
import { route } from "../router";
import { ErrorText } from "../ui/ErrorText";
import { useLoaded } from "../ui/useLoaded";
import { colourOf } from "../ui/verdict";
import { AnswerPanel } from "./AnswerPanel";
import { Truth } from "./Truth";
import { CopyAs } from "./CopyAs";
import { mediaTypeOf, SUFFIXES } from "./media";
import { drawOverlay, type OverlayShares } from "./overlay";

interface Asked {
  name: string;
  type: string;
  encoding: string;
  body: Blob;
}

export function TryView({ map }: { map: string }) {
  const details = useLoaded((signal) => get<Schemas["MapDetails"]>(`/maps/${map}`, {}, signal), [map]);
  const version = route.value.query.get("version") || details.value?.active_version || "";
  const sampleId = route.value.query.get("sample") ?? "";
  const asked = useSignal<Asked | null>(null);
  const answer = useSignal<Schemas["Answer"] | null>(null);
  const chosen = useSignal(0);
  const least = useSignal("");
  const prior = useSignal("");
  const isAsking = useSignal(false);
  const problem = useSignal<unknown>(null);
  const shares = useSignal<OverlayShares | null>(null);
  const scene = useRef<MapScene | null>(null);
  const isReady = useSignal(0);
  const ghosts = useRef(new Group());
  const overlay = useRef(new Group());

  const options: Query = { min_probability: least.value, prior: prior.value, version: route.value.query.get("version") };

  const take = (file: File | undefined) => {
    if (!file) return;
    try {
      asked.value = { name: file.name, type: mediaTypeOf(file.name), encoding: "", body: file };
    } catch (error) {
      problem.value = error;
    }
  };

  useEffect(() => {
    if (!sampleId) return;
    const stop = new AbortController();
    Promise.all([
      get<Schemas["Sample"]>(`/samples/${sampleId}`, {}, stop.signal),
      send("GET", `/samples/${sampleId}/body`, { signal: stop.signal }).then((found) => found.blob()),
    ])
      .then(([sample, body]) => {
        asked.value = { name: sampleId, type: sample.media_type, encoding: sample.content_encoding, body };
      })
      .catch((error: unknown) => {
        if (!stop.signal.aborted) problem.value = error;
      });
    return () => stop.abort();
  }, [sampleId]);

  useEffect(() => {
    const query = asked.value;
    if (!query) return;
    const stop = new AbortController();
    isAsking.value = true;
    problem.value = null;
    const headers: Record<string, string> = { "Content-Type": query.type, "X-Request-Id": `replay-console-${Date.now()}` };
    if (query.encoding) headers["Content-Encoding"] = query.encoding;
    send("POST", "/localize", { query: { map, ...options }, body: query.body, headers, signal: stop.signal })
      .then(async (found) => {
        answer.value = (await found.json()) as Schemas["Answer"];
        chosen.value = 0;
      })
      .catch((error: unknown) => {
        if (!stop.signal.aborted) problem.value = error;
      })
      .finally(() => {
        if (!stop.signal.aborted) isAsking.value = false;
      });
    return () => stop.abort();
  }, [asked.value, least.value, prior.value, version]);

  useEffect(() => {
    const here = scene.current;
    if (!here || !answer.value) return;
    clear(ghosts.current);
    answer.value.hypotheses.forEach((one, i) => {
      const colour = i === chosen.value ? colourOf(answer.value!.verdict) : 0x9aa5b1;
      ghosts.current.add(poseMark(here.local(one.T_map_sensor.position), one.T_map_sensor, colour, i === chosen.value ? 2 : 1.2));
    });
    const place = answer.value.hypotheses[chosen.value];
    if (place) here.lookAt(place.T_map_sensor.position, 25);
    here.redraw();
  }, [answer.value, chosen.value, isReady.value]);

  useEffect(() => {
    const [here, query] = [scene.current, asked.value];
    const place = answer.value?.hypotheses[chosen.value];
    if (!here || !query || !place || !version) return;
    const stop = new AbortController();
    clear(overlay.current);
    shares.value = null; // those of another place
    drawOverlay(here, overlay.current, map, version, place.T_map_sensor, query, stop.signal)
      .then((found) => {
        if (!stop.signal.aborted) shares.value = found;
      })
      .catch((error: unknown) => {
        if (!stop.signal.aborted) problem.value = error;
      });
    return () => stop.abort();
  }, [answer.value, chosen.value, isReady.value, version]);

  if (details.error) return <ErrorText error={details.error} again={details.again} />;
  return (
    <div
      class="map-view"
      onDragOver={(event) => event.preventDefault()}
      onDrop={(event) => {
        event.preventDefault();
        take(event.dataTransfer?.files[0]);
      }}
    >
      {version ? (
        <MapCanvas
          key={version}
          map={map}
          version={version}
          ready={(found) => {
            scene.current = found;
            found?.overlay.add(ghosts.current, overlay.current);
            if (found) found.material.colouring = "plain";
            isReady.value += 1;
          }}
          clicked={(position) => (prior.value = `${position.map((v) => v.toFixed(2)).join(",")},${priorRadius(prior.value)}`)}
        />
      ) : (
        <div class="map-canvas" />
      )}
      <aside class="panel" aria-label="Scan and answer">
        <h2>Try a scan in {map}</h2>
        <label class="drop">
          <span>{asked.value ? asked.value.name : `Drop a scan here: ${SUFFIXES.join(", ")}`}</span>
          <input
            type="file"
            accept={SUFFIXES.join(",")}
            onChange={(event) => take(event.currentTarget.files?.[0])}
          />
        </label>
        <label>
          Least probability {least.value || "of the map"}
          <input
            type="range"
            min={0}
            max={1}
            step={0.01}
            value={least.value || "0.9"}
            onChange={(event) => (least.value = event.currentTarget.value)}
          />
        </label>
        <label>
          Known to be near: x, y, z, radius in metres, and yaw ± range in degrees. A click on the map fills it in
          <input
            placeholder="anywhere"
            value={prior.value}
            onChange={(event) => (prior.value = event.currentTarget.value)}
          />
        </label>
        {isAsking.value ? <p role="status">Asking …</p> : null}
        {problem.value ? <ErrorText error={problem.value} /> : null}
        {answer.value ? (
          <AnswerPanel answer={answer.value} chosen={chosen.value} choose={(i) => (chosen.value = i)} />
        ) : null}
        {shares.value ? (
          <ul class="key">
            <li class="agrees">on the map: {shares.value.agrees} points</li>
            <li class="contradicts">through the map: {shares.value.contradicts}</li>
            <li class="unexplained">not in the map: {shares.value.unexplained}</li>
          </ul>
        ) : null}
        {sampleId && answer.value && mayBuild.value ? (
          <Truth sample={sampleId} map={map} pose={answer.value.hypotheses[chosen.value]?.T_map_sensor ?? null} />
        ) : null}
        {asked.value ? <CopyAs map={map} file={asked.value.name} type={asked.value.type} options={options} /> : null}
      </aside>
    </div>
  );
}

function priorRadius(prior: string): string {
  return prior.split(",").slice(3).join(",") || "5";
}
