// The camera in the address: a link restores it.

import { note } from "../router";
import type { View } from "./framed";

const SETTLED_MS = 300; // after the last movement the camera is noted

/** The camera that an address names; null: none. */
export function viewOf(query: URLSearchParams): View | null {
  const numbers = query.get("view")?.split(",").map(Number) ?? [];
  if (numbers.length !== 6 || !numbers.every(Number.isFinite)) return null;
  const [x, y, z, ex, ey, ez] = numbers as [number, number, number, number, number, number];
  return { target: [x, y, z], eye: [ex, ey, ez] };
}

/** Notes the camera in the address once it rests. */
export class NotedView {
  private waiting = 0;

  moved({ target, eye }: View): void {
    clearTimeout(this.waiting);
    this.waiting = window.setTimeout(() => note({ view: [...target, ...eye].map((m) => m.toFixed(3)).join(",") }), SETTLED_MS);
  }

  /** What has not been noted yet is not noted any more. */
  end(): void {
    clearTimeout(this.waiting);
  }
}
