// The bar above all views: the ways to them, and who is here.

import { caller, key, mayAdminister, mayBuild, signOut } from "./access/session";
import { link, lostMap, route } from "./router";

export function Bar() {
  const [first = "maps", map, part = ""] = route.value.path;
  const isMap = first === "maps" && map !== undefined && map !== lostMap.value;
  return (
    <>
      <button class="skip" onClick={() => document.getElementById("view")?.focus()}>
        Skip to the view
      </button>
      <nav class="bar" aria-label="Views">
        <a class="brand" href={link(["maps"])}>
          firstfix
        </a>
        <Way path={["maps"]} name="Maps" isHere={first === "maps" && !map} />
        {mayBuild.value ? <Way path={["recorded-queries"]} name="Recorded queries" isHere={first === "recorded-queries"} /> : null}
        {mayBuild.value ? <Way path={["live"]} name="Live" isHere={first === "live"} /> : null}
        {mayAdminister.value && caller.value?.maps.includes("*") ? (
          <Way path={["keys"]} name="API keys" isHere={first === "keys"} />
        ) : null}
        {isMap ? (
          <span class="crumbs">
            <Way path={["maps", map]} name={map} isHere={part === ""} />
            <Way path={["maps", map, "try"]} name="Try" isHere={part === "try"} />
            <Way path={["maps", map, "versions"]} name="Versions" isHere={part === "versions"} />
            <Way path={["maps", map, "earth"]} name="On the Earth" isHere={part === "earth"} />
          </span>
        ) : null}
        <span class="caller">
          <a href="../docs">HTTP API</a>
          {caller.value?.read_only ? <span class="tag">read-only</span> : null}
          {caller.value?.authentication ? <span class="who">{caller.value.name}</span> : <span class="tag">open to everyone</span>}
          {key.value ? <button onClick={signOut}>Sign out</button> : null}
        </span>
      </nav>
    </>
  );
}

function Way({ path, name, isHere }: { path: string[]; name: string; isHere: boolean }) {
  return (
    <a href={link(path)} aria-current={isHere ? "page" : undefined}>
      {name}
    </a>
  );
}
