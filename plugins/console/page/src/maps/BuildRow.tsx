// One build: how far it is, how long it takes, or at which stage it failed and why.

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { cancelBuild, followBuild } from "../api/builds";
import type { Schemas } from "../api/client";
import { patchAddress } from "../patch/PatchLink";
import { link } from "../router";
import { Confirm } from "../ui/Confirm";
import { ErrorText } from "../ui/ErrorText";
import { Progress } from "../ui/Progress";
import { age, duration, moment } from "../ui/text";
import { begunAt, hide, isGoing, isHeldBack, patchOf, timesOf } from "./buildRecords";
import { remedyOf } from "./remedy";
import { EndedStages, GoingStages } from "./Stages";
import { seenWith, type SeenStage, timesOfStages } from "./stageTimes";

type Build = Schemas["Build"];

export interface BuildRowProps {
  build: Build;
  isNamed: boolean; // whether the row says which map it is
  done: () => void;
  again: () => void;
}

export function BuildRow({ build, isNamed, done, again }: BuildRowProps) {
  const now = useSignal(build);
  const isAsked = useSignal(false);
  const seen = useSignal<SeenStage[]>(seenWith([], build, Date.now()));
  useEffect(() => {
    if (!isGoing(build)) return;
    const stop = new AbortController();
    const take = (told: Build, isEnd: boolean) => {
      const isServed = told.provisional_version !== now.value.provisional_version;
      now.value = told;
      seen.value = seenWith(seen.value, told, Date.now());
      if (isServed || isEnd) done();
      if (isEnd) stop.abort();
    };
    void followBuild(build.build_id, take, stop.signal);
    return () => stop.abort();
  }, [build.build_id]);
  const { map_id: map, state } = now.value;
  return (
    <li>
      {isNamed ? (
        <strong>
          <a href={link(["maps", map])}>{map}</a>
        </strong>
      ) : null}
      {state === "failed" ? (
        <Failed build={now.value} again={again} />
      ) : isHeldBack(now.value) ? (
        <HeldBack build={now.value} />
      ) : state === "succeeded" ? (
        <span>built</span>
      ) : (
        <>
          <Going build={now.value} />
          <button onClick={() => (isAsked.value = true)}>Cancel</button>
          <GoingStages times={timesOfStages(seen.value, Date.now())} />
        </>
      )}
      {isAsked.value ? (
        <Confirm
          title={`Cancel the build of ${map}`}
          action="Cancel the build"
          keep="Let it go on"
          act={() => cancelBuild(build.build_id)}
          close={() => (isAsked.value = false)}
        >
          <p>
            It is at {Math.round(now.value.progress * 100)} %{pastOf(now.value)}. Stages that have ended are kept for the
            next build of the same source; the stage under way is lost.
          </p>
        </Confirm>
      ) : null}
    </li>
  );
}

function Going({ build }: { build: Build }) {
  const times = timesOf(build, Date.now());
  return (
    <>
      <Progress label={stageOf(build) || "waiting"} share={build.progress} />
      {build.waits_for ? <small role="alert">It waits: {build.waits_for}.</small> : null}
      {times ? (
        <small>
          {duration(times.past_s)}
          {times.left_s === null ? "" : `, about ${duration(times.left_s)} left`}
        </small>
      ) : null}
    </>
  );
}

function Failed({ build, again }: { build: Build; again: () => void }) {
  const begun = begunAt(build.build_id);
  const stage = stageOf(build);
  return (
    <>
      <div class="failed">
        <ErrorText error={new Error(build.error?.detail ?? "The build failed.")} />
        <small>
          {remedyOf(build.error?.code ?? "")} {stage ? `Failed at: ${stage}. ` : ""}
          {begun ? `Handed in ${age(begun)}, ${moment(begun)}.` : ""}
        </small>
        <EndedStages build={build.build_id} />
      </div>
      <button onClick={again}>Try again</button>
      <button onClick={() => hide(build.build_id)}>Hide</button>
    </>
  );
}

function HeldBack({ build }: { build: Build }) {
  const patch = patchOf(build);
  return (
    <>
      <div class="failed">
        {build.findings.map((one) => (
          <p key={one.code} role="alert">
            {one.text} <small>{one.remedy}</small>
          </p>
        ))}
        <EndedStages build={build.build_id} />
      </div>
      {patch ? <a href={patchAddress(build.map_id, patch)}>Before and after</a> : null}
      <a href={link(["maps", build.map_id, "versions"])}>Versions</a>
      <button onClick={() => hide(build.build_id)}>Hide</button>
    </>
  );
}

function stageOf({ stage }: Build): string {
  return stage.replaceAll("_", " ");
}

function pastOf(build: Build): string {
  const times = timesOf(build, Date.now());
  return times ? `, after ${duration(times.past_s)}` : "";
}
