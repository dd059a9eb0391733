// When the picture is drawn: once a frame at most, by the pace of the machine while the camera moves, and whole at rest.

import { MAX_POINTS } from "./levels";
import { Pace } from "./pace";

const REST_MS = 200; // after a frame of a movement, if none follows

export class Frames {
  private readonly pace = new Pace(MAX_POINTS);
  private readonly draw: (mostPoints: number, sharpness: number) => number;
  private frame = 0;
  private rest = 0;
  private isMoving = false;
  private isHeld = false;

  /** `draw` gets the most points that it may draw and the share of pixels along each side, and returns how many points it drew. */
  constructor(draw: (mostPoints: number, sharpness: number) => number) {
    this.draw = draw;
  }

  /** Whether a picture with more points follows when the camera rests. */
  get isReduced(): boolean {
    return this.isMoving && this.pace.isReduced;
  }

  redraw(): void {
    if (!this.frame) this.frame = requestAnimationFrame(() => this.begin());
  }

  /** The camera has moved. */
  moved(): void {
    this.isMoving = true;
    this.redraw();
  }

  /** Somebody holds the camera: until it is let go, it does not rest. */
  hold(isHeld: boolean): void {
    this.isHeld = isHeld;
    if (this.isMoving) this.redraw();
  }

  dispose(): void {
    cancelAnimationFrame(this.frame);
    clearTimeout(this.rest);
  }

  private begin(): void {
    this.frame = 0;
    clearTimeout(this.rest);
    const mostPoints = this.pace.begin(performance.now(), this.isMoving);
    this.pace.drew(this.draw(mostPoints, this.pace.sharpness));
    if (!this.isMoving || this.isHeld) return;
    this.rest = window.setTimeout(() => {
      const isWhole = !this.isReduced;
      this.isMoving = false;
      if (!isWhole) this.redraw();
    }, REST_MS);
  }
}
