// The view in the address: "#/maps/hall?storey=1". A link to it opens the same view.

import { signal } from "@preact/signals";

export interface Route {
  path: string[];
  query: URLSearchParams;
}

function read(): Route {
  const [path = "", query = ""] = location.hash.replace(/^#\/?/, "").split("?");
  return { path: path.split("/").filter(Boolean).map(decodeURIComponent), query: new URLSearchParams(query) };
}

export const route = signal(read());
export const lostMap = signal(""); // a map that an address names and that is not there
addEventListener("hashchange", () => (route.value = read()));

/** The query of the address now, with what was noted since the view was opened. */
export function addressed(): URLSearchParams {
  return read().query;
}

export function link(path: string[], query: Record<string, string> = {}): string {
  const search = new URLSearchParams(query).toString();
  return `#/${path.map(encodeURIComponent).join("/")}${search ? `?${search}` : ""}`;
}

export function go(path: string[], query: Record<string, string> = {}): void {
  location.hash = link(path, query);
}

/** Changes the query of the address without a new entry in the browser's history. */
export function note(query: Record<string, string>): void {
  const { path, query: search } = read(); // not `route`, which knows nothing of earlier notes
  for (const [name, value] of Object.entries(query)) value ? search.set(name, value) : search.delete(name);
  const text = search.toString();
  history.replaceState(null, "", `#/${path.map(encodeURIComponent).join("/")}${text ? `?${text}` : ""}`);
}
