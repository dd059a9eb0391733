// The console: the gate, the way between the views, and the view of the address.

import { render } from "preact";
import { KeysView } from "./access/KeysView";
import { Gate } from "./access/SignIn";
import { caller, key, mayAdminister, mayBuild, signOut } from "./access/session";
import { MapList } from "./maps/MapList";
import { link, route } from "./router";
import "./style.css";
import { Empty } from "./ui/Empty";
import { later } from "./ui/Later";

const LiveView = later(async () => (await import("./live/LiveView")).LiveView);
const MapView = later(async () => (await import("./map3d/MapView")).MapView);
const SamplesView = later(async () => (await import("./samples/SamplesView")).SamplesView);
const TryView = later(async () => (await import("./scan/TryView")).TryView);
const VersionsView = later(async () => (await import("./versions/VersionsView")).VersionsView);

function View() {
  const [first = "maps", map, part] = route.value.path;
  if (first === "live") return <LiveView />;
  if (first === "keys") return <KeysView />;
  if (first === "samples") return <SamplesView />;
  if (first === "maps" && !map) return <MapList />;
  if (first === "maps" && map && !part) return <MapView key={map} map={map} />;
  if (first === "maps" && map && part === "try") return <TryView key={map} map={map} />;
  if (first === "maps" && map && part === "versions") return <VersionsView key={map} map={map} />;
  return (
    <Empty title="There is nothing here">
      <a href={link(["maps"])}>All maps</a>
    </Empty>
  );
}

function Bar() {
  const [first = "maps", map] = route.value.path;
  const here = (name: string) => (first === name ? "page" : undefined);
  return (
    <nav class="bar" aria-label="Views">
      <a class="brand" href={link(["maps"])}>
        firstfix
      </a>
      <a href={link(["maps"])} aria-current={here("maps")}>
        Maps
      </a>
      {mayBuild.value ? (
        <>
          <a href={link(["samples"])} aria-current={here("samples")}>
            Kept queries
          </a>
          <a href={link(["live"])} aria-current={here("live")}>
            Live
          </a>
        </>
      ) : null}
      {mayAdminister.value && caller.value?.maps.includes("*") ? (
        <a href={link(["keys"])} aria-current={here("keys")}>
          Keys
        </a>
      ) : null}
      {first === "maps" && map ? (
        <span class="crumbs">
          <a href={link(["maps", map])}>{map}</a>
          <a href={link(["maps", map, "try"])}>Try</a>
          <a href={link(["maps", map, "versions"])}>Versions</a>
        </span>
      ) : null}
      <span class="caller">
        {caller.value?.read_only ? <span class="tag">read-only</span> : null}
        {caller.value?.authentication ? caller.value.name : ""}
        {key.value ? <button onClick={signOut}>Sign out</button> : null}
      </span>
    </nav>
  );
}

function App() {
  return (
    <Gate>
      <Bar />
      <View />
    </Gate>
  );
}

render(<App />, document.getElementById("app")!);
