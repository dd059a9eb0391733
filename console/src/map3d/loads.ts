// The requests for nodes under way: the most important first, few at a time, and none that nobody needs any more.

export const AT_ONCE = 6; // requests

export interface Wanted {
  key: string;
}

export class Loads<T extends Wanted, Data> {
  private readonly underWay = new Map<string, AbortController>();
  private readonly load: (one: T, signal: AbortSignal) => Promise<Data>;
  private readonly loaded: (one: T, data: Data) => void;
  private readonly failed: (error: unknown) => void;
  private readonly atOnce: number;

  constructor(
    load: (one: T, signal: AbortSignal) => Promise<Data>,
    loaded: (one: T, data: Data) => void,
    failed: (error: unknown) => void,
    atOnce = AT_ONCE,
  ) {
    this.load = load;
    this.loaded = loaded;
    this.failed = failed;
    this.atOnce = atOnce;
  }

  get keys(): string[] {
    return [...this.underWay.keys()];
  }

  /** Follows what is wanted now, in its order: ends other requests, and begins new ones. */
  want(wanted: T[], isThere: (key: string) => boolean): void {
    const keys = new Set(wanted.map(({ key }) => key));
    for (const [key, stop] of this.underWay) {
      if (keys.has(key)) continue;
      stop.abort();
      this.underWay.delete(key);
    }
    for (const one of wanted) {
      if (this.underWay.size >= this.atOnce) return;
      if (!isThere(one.key) && !this.underWay.has(one.key)) this.begin(one);
    }
  }

  end(): void {
    for (const stop of this.underWay.values()) stop.abort();
    this.underWay.clear();
  }

  private begin(one: T): void {
    const stop = new AbortController();
    this.underWay.set(one.key, stop);
    this.load(one, stop.signal).then(
      (data) => this.ended(one, stop, () => this.loaded(one, data)),
      (error: unknown) => this.ended(one, stop, () => this.failed(error)),
    );
  }

  private ended(one: T, stop: AbortController, tell: () => void): void {
    if (stop.signal.aborted) return; // another request for the same node may be under way by now
    this.underWay.delete(one.key);
    tell();
  }
}

export interface Kept {
  count: number;
  used: number; // the last round that drew it
}

/** Which loaded nodes to free: not those of this round, the longest unused first, until there are few enough points. */
export function toFree(kept: ReadonlyMap<string, Kept>, round: number, mostPoints: number): string[] {
  let points = 0;
  for (const { count } of kept.values()) points += count;
  const freed: string[] = [];
  for (const [key, { count, used }] of [...kept].sort(([, a], [, b]) => a.used - b.used)) {
    if (points <= mostPoints || used >= round) break;
    freed.push(key);
    points -= count;
  }
  return freed;
}
