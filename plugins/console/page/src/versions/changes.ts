// What differs between the manifests of two versions: their sources, settings and engine, one line for each value.

export interface Change {
  name: string; // "config.simulate.max_rays"
  before: string;
  after: string;
}

const PARTS = ["source", "sensor", "config", "engine", "counts", "bounds", "format"]; // the rest are digests and results
const LONGEST = 80;

export function changesOf(before: Record<string, unknown>, after: Record<string, unknown>): Change[] {
  const [old, now] = [new Map<string, string>(), new Map<string, string>()];
  for (const part of PARTS) {
    flatten(part, before[part], old);
    flatten(part, after[part], now);
  }
  const names = [...new Set([...old.keys(), ...now.keys()])];
  return names
    .filter((name) => old.get(name) !== now.get(name))
    .map((name) => ({ name, before: short(old.get(name)), after: short(now.get(name)) }));
}

function flatten(name: string, value: unknown, into: Map<string, string>): void {
  if (value !== null && typeof value === "object" && !Array.isArray(value)) {
    for (const [key, inner] of Object.entries(value)) flatten(`${name}.${key}`, inner, into);
  } else if (value !== undefined && value !== null) {
    into.set(name, typeof value === "string" ? value : JSON.stringify(value));
  }
}

function short(text: string | undefined): string {
  if (text === undefined) return "none";
  return text.length > LONGEST ? `${text.slice(0, LONGEST)} …` : text;
}
