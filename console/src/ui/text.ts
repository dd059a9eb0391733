// Numbers, sizes and times as people read them.

const UNITS = ["B", "KB", "MB", "GB", "TB"];

export function size(bytes: number): string {
  let unit = 0;
  while (bytes >= 1000 && unit < UNITS.length - 1) {
    bytes /= 1000;
    unit += 1;
  }
  return `${unit === 0 || bytes >= 100 ? bytes.toFixed(0) : bytes.toFixed(1)} ${UNITS[unit]}`;
}

export function count(n: number): string {
  return n.toLocaleString("en-GB");
}

export function percent(share: number, digits = 0): string {
  return `${(share * 100).toFixed(digits)} %`;
}

export function age(iso: string, now = Date.now()): string {
  const seconds = Math.max(0, (now - Date.parse(iso)) / 1000);
  for (const [name, length] of [
    ["day", 86400],
    ["hour", 3600],
    ["minute", 60],
  ] as const) {
    const n = Math.floor(seconds / length);
    if (n >= 1) return `${n} ${name}${n > 1 ? "s" : ""} ago`;
  }
  return "just now";
}

export function short(version: string): string {
  return version.slice(0, 12);
}

export function metres(m: number): string {
  return `${m.toFixed(2)} m`;
}

const REASONS: Record<string, string> = {
  too_few_points: "The scan has too few points.",
  no_candidate: "No place of the map looks like the scan.",
  low_inlier_ratio: "Too little of the scan lies on the map.",
  free_space_violation: "The scan looks through surfaces of the map.",
  low_probability: "The best place is too uncertain.",
  not_converged: "The alignment did not come to rest.",
  several_places: "Several places explain the scan equally well.",
  wrong_frame: "The scan was not taken from its own origin.",
  not_registered: "The query had no points, so its places are only candidates.",
};

export const REASON_CODES = Object.keys(REASONS);

export function reason(code: string): string {
  return REASONS[code] ?? code.replaceAll("_", " ");
}
