// What a frame draws: all points at rest, and while the camera moves as many as the machine draws fast enough. Where the
// fewest are still too slow, the picture's own pixels are what takes long, as without a graphics card: it gets fewer.

export const MIN_POINTS = 40_000;
export const FIRST_POINTS = 300_000; // of the first frame: nobody waits a second for it, and a quick machine soon draws all
const SLOW_MS = 33; // a frame that took longer: fewer points, for 30 frames a second
const QUICK_MS = 20; // one that took less: more of them
const GROWTH = 1.3;
export const COARSE = 0.5; // of the picture's width and height

export class Pace {
  private readonly whole: number;
  private most: number;
  private isCoarse = false; // of this movement: each begins with a whole picture
  private last: { begin_ms: number; points: number } | null = null; // frame of the movement under way

  /** `whole`: the most points of a picture at rest. */
  constructor(whole: number) {
    this.whole = whole;
    this.most = Math.min(FIRST_POINTS, whole);
  }

  /** Whether a movement is drawn with fewer points than a picture at rest. */
  get isReduced(): boolean {
    return this.most < this.whole || this.isCoarse;
  }

  /** Share of the picture's width and height in pixels that a frame has. */
  get sharpness(): number {
    return this.isCoarse ? COARSE : 1;
  }

  /** The most points of a frame that begins now. */
  begin(now_ms: number, isMoving: boolean): number {
    if (!isMoving) {
      this.last = null;
      this.isCoarse = false;
      return this.whole;
    }
    if (this.last) this.learn(now_ms - this.last.begin_ms, this.last.points);
    this.last = { begin_ms: now_ms, points: 0 };
    return this.most;
  }

  /** Notes how many points the frame drew. */
  drew(points: number): void {
    if (this.last) this.last.points = points;
  }

  private learn(took_ms: number, points: number): void {
    if (took_ms > SLOW_MS) {
      if (Math.min(points, this.most) <= MIN_POINTS) this.isCoarse = true;
      this.most = Math.max(MIN_POINTS, Math.min(this.most, (points * SLOW_MS) / took_ms));
    } else if (took_ms < QUICK_MS) {
      this.most = Math.min(this.whole, this.most * GROWTH);
    }
  }
}
