// The requests for nodes under way: the most important first, few at a time, and none that nobody needs any more.
// Nodes that stand one after the other in the file come with one request: each request costs the service time.

export const AT_ONCE = 6; // requests
const MAX_TOGETHER = 100_000; // points of one request, unless its first node has more

export interface Wanted {
  key: string;
  first: number; // point in the file
  count: number;
}

interface Request {
  keys: Set<string>;
  stop: AbortController;
}

export class Loads<T extends Wanted, Data> {
  private readonly underWay = new Set<Request>();
  private readonly load: (run: T[], signal: AbortSignal) => Promise<Data[]>;
  private readonly loaded: (one: T, data: Data) => void;
  private readonly failed: (error: unknown) => void;
  private readonly atOnce: number;

  /** `load` gets nodes that stand one after the other. */
  constructor(
    load: (run: T[], signal: AbortSignal) => Promise<Data[]>,
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
    return [...this.underWay].flatMap(({ keys }) => [...keys]);
  }

  /** Follows what is wanted now, in its order: ends requests of which no node is, and begins new ones. */
  want(wanted: T[], isThere: (key: string) => boolean): void {
    const wantedKeys = new Set(wanted.map(({ key }) => key));
    for (const request of this.underWay) {
      if ([...request.keys].some((key) => wantedKeys.has(key))) continue;
      request.stop.abort();
      this.underWay.delete(request);
    }
    const asked = new Set(this.keys);
    const missing = wanted.filter(({ key }) => !isThere(key) && !asked.has(key));
    const byFirst = new Map(missing.map((one) => [one.first, one]));
    for (const one of missing) {
      if (this.underWay.size >= this.atOnce) return;
      if (byFirst.has(one.first)) this.begin(takenRun(byFirst, one));
    }
  }

  end(): void {
    for (const { stop } of this.underWay) stop.abort();
    this.underWay.clear();
  }

  private begin(run: T[]): void {
    const request = { keys: new Set(run.map(({ key }) => key)), stop: new AbortController() };
    this.underWay.add(request);
    this.load(run, request.stop.signal).then(
      (found) => this.ended(request, () => run.forEach((one, i) => this.loaded(one, found[i]!))),
      (error: unknown) => this.ended(request, () => this.failed(error)),
    );
  }

  private ended(request: Request, tell: () => void): void {
    if (request.stop.signal.aborted) return; // another request for the same nodes may be under way by now
    this.underWay.delete(request);
    tell();
  }
}

/** Nodes that are all wanted, in requests of nodes that stand one after the other in the file. */
export function runsOf<T extends Wanted>(wanted: readonly T[]): T[][] {
  const byFirst = new Map(wanted.map((one) => [one.first, one]));
  const runs: T[][] = [];
  for (const one of [...wanted].sort((a, b) => a.first - b.first)) {
    if (byFirst.has(one.first)) runs.push(takenRun(byFirst, one));
  }
  return runs;
}

/** Takes a node, and those that follow it in the file, out of the nodes by their first point. */
function takenRun<T extends Wanted>(byFirst: Map<number, T>, from: T): T[] {
  const run: T[] = [];
  let next: T | undefined = from;
  for (let points = 0; next && (!run.length || points + next.count <= MAX_TOGETHER); ) {
    run.push(next);
    byFirst.delete(next.first);
    points += next.count;
    next = byFirst.get(next.first + next.count);
  }
  return run;
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
