// Builds under way, with their stages as they come, and the last that failed.

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { change, get, type Schemas } from "../api/client";
import { follow } from "../api/events";
import { ErrorText } from "../ui/ErrorText";
import { Progress } from "../ui/Progress";

type Build = Schemas["Build"];
const LOOK_MS = 3000;

export function Builds({ done }: { done: () => void }) {
  const builds = useSignal<Build[]>([]);
  const problem = useSignal<unknown>(null);
  const hidden = useSignal<string[]>([]);
  useEffect(() => {
    let going = true;
    const look = async () => {
      try {
        const found = (await get<Schemas["BuildPage"]>("/builds", { limit: 20 })).builds;
        const under = builds.value.filter(isGoing).map((one) => one.build_id);
        builds.value = found;
        // its row is gone now, perhaps before the end came over its stream
        if (found.some((one) => one.state === "succeeded" && under.includes(one.build_id))) done();
        problem.value = null;
      } catch (error) {
        problem.value = error;
      }
      if (going) setTimeout(look, LOOK_MS);
    };
    void look();
    return () => {
      going = false;
    };
  }, []);
  const shown = builds.value.filter(
    (one) => !hidden.value.includes(one.build_id) && ["queued", "running", "failed"].includes(one.state),
  );
  if (problem.value) return <ErrorText error={problem.value} />;
  if (!shown.length) return null;
  return (
    <section aria-label="Builds">
      <h2>Builds</h2>
      <ul class="builds">
        {shown.slice(0, 10).map((one) => (
          <BuildRow
            key={one.build_id}
            build={one}
            done={done}
            hide={() => (hidden.value = [...hidden.value, one.build_id])}
          />
        ))}
      </ul>
    </section>
  );
}

function BuildRow({ build, done, hide }: { build: Build; done: () => void; hide: () => void }) {
  const now = useSignal(build);
  const problem = useSignal<unknown>(null);
  useEffect(() => {
    if (!isGoing(build)) return;
    const stop = new AbortController();
    void follow(
      `/builds/${build.build_id}/events`,
      () => ({}),
      (event) => {
        now.value = event.data as Build;
        if (now.value.provisional_version || event.name === "end") done();
        if (event.name === "end") stop.abort();
      },
      stop.signal,
    );
    return () => stop.abort();
  }, [build.build_id]);
  const cancel = () =>
    change("DELETE", `/builds/${build.build_id}`).catch((error: unknown) => (problem.value = error));
  return (
    <li>
      <strong>{now.value.map_id}</strong>
      {now.value.state === "failed" ? (
        <>
          <ErrorText error={new Error(now.value.error?.detail ?? "The build failed.")} />
          <button onClick={hide}>Hide</button>
        </>
      ) : now.value.state === "succeeded" ? (
        <span>built</span>
      ) : (
        <>
          <Progress label={now.value.stage.replaceAll("_", " ") || "waiting"} share={now.value.progress} />
          <button onClick={cancel}>Cancel</button>
        </>
      )}
      {problem.value ? <ErrorText error={problem.value} /> : null}
    </li>
  );
}

function isGoing({ state }: Build): boolean {
  return state === "queued" || state === "running";
}
