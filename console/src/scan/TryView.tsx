// Try a scan: where does the service say it was taken, and does that look right?

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Group } from "three";
import { key, mayBuild } from "../access/session";
import { get, type Query, type Schemas } from "../api/client";
import { MapCanvas } from "../map3d/MapCanvas";
import { poseMark } from "../map3d/marks";
import type { HandleMode } from "../map3d/poseHandle";
import { clear, type MapScene } from "../map3d/scene";
import { route } from "../router";
import { ErrorText } from "../ui/ErrorText";
import { useLoaded } from "../ui/useLoaded";
import { colourOf } from "../ui/verdict";
import { AnswerPanel } from "./AnswerPanel";
import { CopyAs } from "./CopyAs";
import { gravityOf, type HandPose, handPoseAt, handPoseOf, poseOf, priorOf } from "./handPose";
import { HandPanel } from "./HandPanel";
import { SUFFIXES } from "./media";
import { ScanKey } from "./ScanKey";
import { Truth } from "./Truth";
import { useAnswer } from "./useAnswer";
import { useAsked } from "./useAsked";
import { useHandle } from "./useHandle";
import { useOverlay } from "./useOverlay";
import { VersionChoice } from "./VersionChoice";

const USUAL_LEAST = "0.995"; // of a map that was built without a threshold of its own

export function TryView({ map }: { map: string }) {
  const details = useLoaded((signal) => get<Schemas["MapDetails"]>(`/maps/${map}`, {}, signal), [map]);
  const active = details.value?.active_version ?? "";
  const version = route.value.query.get("version") || active;
  const sampleId = route.value.query.get("sample") ?? "";
  const least = useSignal("");
  const hand = {
    pose: useSignal<HandPose | null>(null),
    settled: useSignal<HandPose | null>(null),
    mode: useSignal<HandleMode>("translate"),
  };
  const isPrior = useSignal(true);
  const isTiltKnown = useSignal(false);
  const isLaidByHand = useSignal(false);
  const problem = useSignal<unknown>(null);
  const scene = useRef<MapScene | null>(null);
  const isReady = useSignal(0);
  const ghosts = useRef(new Group()).current;
  const looked = useRef<unknown>(null);

  const settled = hand.settled.value;
  const isNear = settled !== null && isPrior.value;
  const options: Query = {
    min_probability: least.value,
    prior: isNear ? priorOf(settled) : "",
    gravity: isNear && isTiltKnown.value ? gravityOf(settled) : "",
    version: route.value.query.get("version"),
  };
  const { asked, take } = useAsked(sampleId, problem);
  const { answer, chosen, isAsking } = useAnswer(map, asked.value, options, problem);
  const place = answer.value?.hypotheses[chosen.value]?.T_map_sensor ?? null;
  const byHand = settled && poseOf(settled);
  const laid = isLaidByHand.value && byHand ? byHand : place;
  const overlay = useOverlay(scene, isReady.value, map, version, asked.value, laid, problem);
  useHandle(scene, isReady.value, hand, (pose) => isLaidByHand.value && overlay.moved(pose));

  useEffect(() => {
    const here = scene.current;
    if (!here || !answer.value) return;
    clear(ghosts);
    answer.value.hypotheses.forEach((one, i) => {
      const colour = i === chosen.value ? colourOf(answer.value!.verdict) : 0x9aa5b1;
      ghosts.add(poseMark(here.local(one.T_map_sensor.position), one.T_map_sensor, colour, i === chosen.value ? 2 : 1.2));
    });
    here.redraw();
  }, [answer.value, chosen.value, isReady.value]);

  useEffect(() => {
    // The camera goes to a place that was chosen, and stays while a pose is dragged.
    if (!scene.current || !place) return;
    const what = `${asked.value?.name} ${chosen.value} ${isReady.value}`;
    if (looked.current !== what) scene.current.lookAt(place.position, 25);
    looked.current = what;
  }, [place, isReady.value]);

  const begin = () => {
    const pose = place ?? { position: scene.current?.view.target ?? [0, 0, 0], quaternion: [0, 0, 0, 1] };
    setHand(handPoseOf(pose, null));
  };
  const setHand = (pose: HandPose) => {
    hand.pose.value = pose;
    hand.settled.value = pose;
  };

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
            found?.overlay.add(ghosts, overlay.group);
            if (found) found.material.colouring = "plain";
            isReady.value += 1;
          }}
          clicked={(position) => setHand(handPoseAt(position, hand.pose.value))}
        />
      ) : (
        <div class="map-canvas" />
      )}
      <aside class="panel" aria-label="Scan and answer">
        <h2>Try a scan in {map}</h2>
        <label class="drop">
          <span>{asked.value ? asked.value.name : `Drop a scan here: ${SUFFIXES.join(", ")}`}</span>
          <input type="file" accept={SUFFIXES.join(",")} onChange={(event) => take(event.currentTarget.files?.[0])} />
        </label>
        <VersionChoice map={map} active={active} />
        <label>
          Least probability {least.value || "of the map"}
          <input
            type="range"
            min={0}
            max={1}
            step={0.005}
            value={least.value || USUAL_LEAST}
            onChange={(event) => (least.value = event.currentTarget.value)}
          />
        </label>
        {least.value ? <button onClick={() => (least.value = "")}>As the map has it</button> : null}
        <HandPanel hand={hand} isPrior={isPrior} isTiltKnown={isTiltKnown} begin={begin} />
        {byHand && asked.value ? (
          <label class="check">
            <input
              type="checkbox"
              checked={isLaidByHand.value}
              onChange={(event) => (isLaidByHand.value = event.currentTarget.checked)}
            />
            Lay the scan at the pose by hand
          </label>
        ) : null}
        {isAsking.value ? <p role="status">Asking …</p> : null}
        {problem.value ? <ErrorText error={problem.value} /> : null}
        {answer.value ? (
          <AnswerPanel answer={answer.value} chosen={chosen.value} choose={(i) => (chosen.value = i)} />
        ) : null}
        {overlay.shares.value ? <ScanKey shares={overlay.shares.value} /> : null}
        {sampleId && mayBuild.value ? <Truth sample={sampleId} map={map} place={place} hand={byHand} /> : null}
        {asked.value ? (
          <CopyAs
            map={map}
            file={asked.value.name}
            type={asked.value.type}
            encoding={asked.value.encoding}
            options={options}
            isSignedIn={key.value !== ""}
          />
        ) : null}
      </aside>
    </div>
  );
}
