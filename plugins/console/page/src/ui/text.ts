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

/** A probability with as many digits as it takes: what is not certain is never called 100 %. */
export function chance(probability: number, fewest = 1): string {
  if (probability > 0 && probability < 0.0005) return "under 0.1 %";
  for (let digits = fewest; digits <= 4; digits++) {
    const text = percent(probability, digits);
    if (probability >= 1 || parseFloat(text) < 100) return text;
  }
  return "over 99.9999 %";
}

/** Two probabilities that are compared, with digits enough to see which one is less. */
export function chances(one: number, other: number): [string, string] {
  for (let digits = 1; digits < 4; digits++) {
    const texts: [string, string] = [chance(one, digits), chance(other, digits)];
    if (texts[0] !== texts[1]) return texts;
  }
  return [chance(one, 4), chance(other, 4)];
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

/** The time of day, to the second. */
export function clock(ms: number): string {
  return new Date(ms).toLocaleTimeString("en-GB");
}

/** Day and time where the page is looked at: "29 Nov 2026, 14:02". */
export function moment(iso: string): string {
  return new Date(iso).toLocaleString("en-GB", { day: "numeric", month: "short", year: "numeric", hour: "2-digit", minute: "2-digit" });
}

/** A length of time: "2 h 05 min", "12 min", "1 min 30 s", "20 s", "0.4 s". */
export function duration(seconds: number): string {
  if (seconds < 0.05) return "under 0.1 s";
  if (seconds < 0.95) return `${seconds.toFixed(1)} s`;
  const whole = Math.round(seconds);
  if (whole < 60) return `${whole} s`;
  if (whole < 600) return `${Math.floor(whole / 60)} min ${String(whole % 60).padStart(2, "0")} s`;
  const minutes = Math.round(seconds / 60);
  return minutes < 60 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, "0")} min`;
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
  low_probability: "The best place is not sure enough.",
  not_converged: "The alignment did not come to rest.",
  wrong_frame: "The scan was not taken from its own origin.",
  several_places: "Other places explain the scan about as well.",
  not_registered: "The query had no points, so its places are only candidates.",
};

export const REASON_CODES = Object.keys(REASONS);

export function reason(code: string): string {
  return REASONS[code] ?? code.replaceAll("_", " ");
}
