// Try a scan: where does the service say it was taken, and does that look right?

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { key, mayBuild } from "../access/session";
import { mapDetails, versionDetails } from "../api/maps";
import type { LocalizeQuery } from "../api/scans";
import { MapCanvas } from "../map3d/MapCanvas";
import type { MapScene } from "../map3d/scene";
import { leastOf, manifestOf } from "../maps/manifest";
import { MapProblem } from "../maps/MapProblem";
import { route } from "../router";
import { Check } from "../ui/Check";
import { ErrorText } from "../ui/ErrorText";
import { useLoaded } from "../ui/useLoaded";
import { AnswerPanel } from "./AnswerPanel";
import { CopyAs } from "./CopyAs";
import { Examples } from "./Examples";
import { gravityOf, type HandPose, handPoseAt, handPoseOf, poseOf, priorOf } from "./handPose";
import { HandPanel } from "./HandPanel";
import { LeastField } from "./LeastField";
import { ScanKey } from "./ScanKey";
import { TakeScan } from "./TakeScan";
import { Truth } from "./Truth";
import { Understood } from "./Understood";
import { useAnswer } from "./useAnswer";
import { useAsked } from "./useAsked";
import { useHandle } from "./useHandle";
import { useOverlay } from "./useOverlay";
import { usePlaceMarks } from "./usePlaceMarks";
import { useTryState } from "./useTryState";
import { VersionChoice } from "./VersionChoice";

const AROUND_M = 25; // from where a place is looked at, in a map that is larger than that

export function TryView({ map }: { map: string }) {
  const details = useLoaded((signal) => mapDetails(map, signal), [map]);
  const active = details.value?.active_version ?? "";
  const version = route.value.query.get("version") || active;
  const queryId = route.value.query.get("recorded") ?? "";
  const ofMap = useLoaded(
    async (signal) =>
      version ? leastOf(manifestOf(await versionDetails(map, version, signal))) : null,
    [map, version],
  );
  const { least, hand, isPrior, isTiltKnown, isLaidByHand } = useTryState();
  const areOthersShown = useSignal(true);
  const problem = useSignal<unknown>(null);
  const scene = useRef<MapScene | null>(null);
  const isReady = useSignal(0);
  const looked = useRef<unknown>(null);

  const settled = hand.settled.value;
  const isNear = settled !== null && isPrior.value;
  const options: LocalizeQuery = {
    min_probability: least.value || undefined,
    prior: isNear ? priorOf(settled) : undefined,
    gravity: isNear && isTiltKnown.value ? gravityOf(settled) : undefined,
    version: route.value.query.get("version") ?? undefined,
  };
  const { asked, take, give } = useAsked(queryId, problem);
  const { answer, chosen, isAsking } = useAnswer(map, asked.value, options, problem);
  const place = answer.value?.hypotheses[chosen.value]?.T_map_sensor ?? null;
  const byHand = settled && poseOf(settled);
  const laid = isLaidByHand.value && byHand ? byHand : place;
  const overlay = useOverlay(scene, isReady.value, map, version, asked.value, laid, problem);
  useHandle(scene, isReady.value, hand, (pose) => isLaidByHand.value && overlay.moved(pose));

  const places = usePlaceMarks(scene, isReady.value, answer.value, chosen.value, areOthersShown.value);

  useEffect(() => {
    // The camera goes to a place that was chosen, and stays while a pose is dragged.
    if (!scene.current || !place) return;
    const what = `${asked.value?.name} ${chosen.value} ${isReady.value}`;
    if (looked.current !== what) scene.current.lookAround(place.position, AROUND_M);
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

  if (details.error) return <MapProblem map={map} error={details.error} again={details.again} />;
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
            found?.overlay.add(places, overlay.group);
            if (found) found.material.colouring = "plain";
            isReady.value += 1;
          }}
          clicked={(position) => setHand(handPoseAt(position, hand.pose.value))}
        />
      ) : (
        <div class="map-canvas" />
      )}
      <aside class="panel wide" aria-label="Scan and answer">
        <h2>Try a scan in {map}</h2>
        <TakeScan map={map} name={asked.value?.name ?? ""} take={take} />
        <Examples map={map} version={version} clicked={hand.pose.value?.position ?? null} asked={asked.value} take={give} problem={problem} />
        {isAsking.value ? <p role="status">Asking …</p> : null}
        {problem.value ? <ErrorText error={problem.value} /> : null}
        {answer.value ? (
          <AnswerPanel
            answer={answer.value}
            least={Number(least.value) || ofMap.value || 0}
            guide={isNear ? `searched only within ${settled.radius_m} m of the pose by hand` : ""}
            chosen={chosen.value}
            choose={(i) => (chosen.value = i)}
          />
        ) : null}
        {(answer.value?.hypotheses.length ?? 0) > 1 ? (
          <Check value={areOthersShown}>Show the other places on the map</Check>
        ) : null}
        {overlay.shares.value ? <ScanKey shares={overlay.shares.value} /> : null}
        {asked.value && !asked.value.spot ? (
          <Understood asked={asked.value} isAnswered={answer.value !== null} isRefused={problem.value !== null} />
        ) : null}
        {queryId && mayBuild.value ? <Truth queryId={queryId} map={map} place={place} hand={byHand} /> : null}
        <h3>How it is asked</h3>
        <VersionChoice map={map} active={active} />
        {ofMap.value === null ? null : <LeastField least={least} ofMap={ofMap.value} />}
        <HandPanel hand={hand} isPrior={isPrior} isTiltKnown={isTiltKnown} begin={begin} />
        {byHand && asked.value ? <Check value={isLaidByHand}>Lay the scan at the pose by hand</Check> : null}
        {asked.value && !asked.value.spot ? (
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
