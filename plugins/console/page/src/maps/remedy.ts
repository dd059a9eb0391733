// What helps a build that failed, by the code of its error.

const CHECK = "firstfix check FILE reads the file without a build, and says what is wrong with it.";
const MEMORY = "Its process died, mostly for want of memory: give it more, or thin out the map.";
const GOES_ON = "Another try goes on behind the stages that have ended.";

const REMEDIES: Record<string, string> = {
  invalid_input: CHECK,
  malformed_data: CHECK,
  unsupported_format: CHECK,
  too_large: CHECK,
  unfit_map: "", // its text has the remedies
  build_attempts_exceeded: MEMORY,
  worker_lost: MEMORY,
  build_timed_out: GOES_ON,
  build_stalled: GOES_ON,
  cluster_unavailable: GOES_ON,
  out_of_space: "Make room in the store, or on the disk for builds. Then try again.",
};

export function remedyOf(code: string): string {
  return REMEDIES[code] ?? "Try again. If it fails in the same way, the log of the service says more.";
}
