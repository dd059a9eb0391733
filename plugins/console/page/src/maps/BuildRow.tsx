// One build: how far it is, how long it takes, or at which stage it failed and why.

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { mayAdminister } from "../access/session";
import { cancelBuild, followBuild } from "../api/builds";
import type { Schemas } from "../api/client";
import { patchAddress } from "../patch/PatchLink";
import { link } from "../router";
import { Confirm } from "../ui/Confirm";
import { ErrorText } from "../ui/ErrorText";
import { Progress } from "../ui/Progress";
import { age, duration, moment } from "../ui/text";
import { BuildLog } from "./BuildLog";
import { begunAt, hide, isGoing, isHeldBack, patchOf, timesOf, whyItWaits } from "./buildRecords";
import { remedyOf } from "./remedy";
import { EndedStages, GoingStages, nameOf } from "./Stages";

type Build = Schemas["Build"];
const TICK_MS = 1000;

export interface BuildRowProps {
  build: Build;
  builds: Build[]; // all that the caller sees
  isNamed: boolean; // whether the row says which map it is
  done: () => void;
  again: () => void;
}

export function BuildRow({ build, builds, isNamed, done, again }: BuildRowProps) {
  const now = useSignal(build);
  const isAsked = useSignal(false);
  const now_ms = useSignal(Date.now());
  useEffect(() => {
    if (!isGoing(build)) return;
    const stop = new AbortController();
    const take = (told: Build, isEnd: boolean) => {
      const isServed = told.provisional_version !== now.value.provisional_version;
      now.value = told;
      now_ms.value = Date.now();
      if (isServed || isEnd) done();
      if (isEnd) stop.abort();
    };
    void followBuild(build.build_id, take, stop.signal);
    const ticks = setInterval(() => (now_ms.value = Date.now()), TICK_MS);
    return () => {
      stop.abort();
      clearInterval(ticks);
    };
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
        <span class="of-build">built</span>
      ) : (
        <>
          <Going build={now.value} builds={builds} now_ms={now_ms.value} />
          <span class="actions">
            <button onClick={() => (isAsked.value = true)}>Cancel</button>
          </span>
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

function Going({ build, builds, now_ms }: { build: Build; builds: Build[]; now_ms: number }) {
  const times = timesOf(build, now_ms);
  const waits = whyItWaits(build, builds);
  return (
    <div class="of-build">
      <Progress label={waits ? "waiting" : nameOf(build.stage)} share={build.progress} />
      {waits ? <p role={build.waits_for || build.error ? "alert" : "status"}>{waits}</p> : null}
      {times ? (
        <small>
          Handed in {duration(times.past_s)} ago
          {times.left_s === null ? "" : `, about ${duration(times.left_s)} left`}
        </small>
      ) : null}
      {build.state === "running" && build.stage ? <GoingStages build={build} now_ms={now_ms} /> : null}
    </div>
  );
}

function Failed({ build, again }: { build: Build; again: () => void }) {
  const begun = begunAt(build.build_id);
  const stage = nameOf(build.stage);
  return (
    <>
      <div class="of-build failed">
        <ErrorText error={new Error(build.error?.detail ?? "The build failed.")} />
        <small>
          {remedyOf(build.error?.code ?? "")} {stage ? `Failed at: ${stage}. ` : ""}
          {begun ? `Handed in ${age(begun)}, ${moment(begun)}.` : ""}
        </small>
        <EndedStages build={build.build_id} />
        {mayAdminister.value ? <BuildLog build={build.build_id} /> : null}
      </div>
      <span class="actions">
        <button onClick={again}>Try again</button>
        <button onClick={() => hide(build.build_id)}>Hide</button>
      </span>
    </>
  );
}

function HeldBack({ build }: { build: Build }) {
  const patch = patchOf(build);
  return (
    <>
      <div class="of-build failed">
        {build.findings.map((one) => (
          <p key={one.code} role="alert">
            {one.text} <small>{one.remedy}</small>
          </p>
        ))}
        <EndedStages build={build.build_id} />
      </div>
      <span class="actions">
        {patch ? <a href={patchAddress(build.map_id, patch)}>Before and after</a> : null}
        <a href={link(["maps", build.map_id, "versions"])}>Versions</a>
        <button onClick={() => hide(build.build_id)}>Hide</button>
      </span>
    </>
  );
}

function pastOf(build: Build): string {
  const times = timesOf(build, Date.now());
  return times ? `, after ${duration(times.past_s)}` : "";
}
