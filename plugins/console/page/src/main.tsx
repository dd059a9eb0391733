// The console: the gate, the bar, and the view of the address.

import { render } from "preact";
import { KeysView } from "./access/KeysView";
import { Gate } from "./access/SignIn";
import { Bar } from "./Bar";
import { MapList } from "./maps/MapList";
import { link, route } from "./router";
import "./style.css";
import { Empty } from "./ui/Empty";
import { later } from "./ui/Later";

const EarthView = later(async () => (await import("./earth/EarthView")).EarthView);
const LiveView = later(async () => (await import("./live/LiveView")).LiveView);
const MapView = later(async () => (await import("./map3d/MapView")).MapView);
const PatchView = later(async () => (await import("./patch/PatchView")).PatchView);
const RecordedView = later(async () => (await import("./recorded/RecordedView")).RecordedView);
const TryView = later(async () => (await import("./scan/TryView")).TryView);
const VersionsView = later(async () => (await import("./versions/VersionsView")).VersionsView);

function View() {
  const [first = "maps", map, part] = route.value.path;
  if (first === "live") return <LiveView />;
  if (first === "keys") return <KeysView />;
  if (first === "recorded-queries") return <RecordedView />;
  if (first === "maps" && !map) return <MapList />;
  if (first === "maps" && map && !part) return <MapView key={map} map={map} />;
  if (first === "maps" && map && part === "try") return <TryView key={map} map={map} />;
  if (first === "maps" && map && part === "versions") return <VersionsView key={map} map={map} />;
  if (first === "maps" && map && part === "patch") return <PatchView key={`${map} ${route.value.query.get("version")}`} map={map} />;
  if (first === "maps" && map && part === "earth") return <EarthView key={map} map={map} />;
  return (
    <Empty title="There is nothing here">
      <a href={link(["maps"])}>All maps</a>
    </Empty>
  );
}

function App() {
  return (
    <Gate>
      <Bar />
      <div id="view" tabIndex={-1}>
        <View />
      </div>
    </Gate>
  );
}

render(<App />, document.getElementById("app")!);
