// The robots that ask, from the answers that are known, and what about them needs a person.

import type { Fix } from "./seconds";

export const SILENT_S = 60; // without a question from a robot that was not localized
export const MIN_LOCALIZED = 0.8; // share of a robot's answers
const MIN_ANSWERS = 5; // before a share says something

export interface Robot {
  name: string; // of the robot, else of the caller
  caller: string; // who asks for it
  last: Fix;
  lastFix: Fix | null; // the last answer with a pose
  answers: number;
  localized: number;
}

/** Those whose answers are known, the one that asked last first. */
export function robotsOf(fixes: readonly Fix[]): Robot[] {
  const found = new Map<string, Robot>();
  for (const fix of fixes) {
    const key = `${fix.caller} ${fix.robot}`; // two gateways may have a robot of one name each
    const before = found.get(key);
    found.set(key, {
      name: nameOf(fix),
      caller: fix.caller,
      last: fix,
      lastFix: fix.answer.T_map_sensor ? fix : (before?.lastFix ?? null),
      answers: (before?.answers ?? 0) + 1,
      localized: (before?.localized ?? 0) + (fix.answer.verdict === "localized" ? 1 : 0),
    });
  }
  return [...found.values()].sort((a, b) => b.last.time_s - a.last.time_s);
}

/** What people call the robot that an answer was for. */
export function nameOf({ robot, caller }: Fix): string {
  return robot || caller;
}

export interface Alert {
  id: string; // stands in the address of a link to it
  text: string;
  look?: string; // address of where it is dealt with
}

export function alertsOf(robots: readonly Robot[], now_s: number): Alert[] {
  return robots.flatMap((robot) => {
    const found: Alert[] = [];
    const share = robot.localized / robot.answers;
    if (robot.answers >= MIN_ANSWERS && share < MIN_LOCALIZED) {
      const text = `${robot.name}: ${robot.localized} of its last ${robot.answers} answers were localized. Look at its recorded queries.`;
      found.push({ id: `localized:${robot.name}`, text });
    }
    const silent_s = now_s - robot.last.time_s;
    if (silent_s > SILENT_S && robot.last.answer.verdict !== "localized") {
      // one that is localized rests: it asks again when it is lost
      const text = `${robot.name} was not localized, and has not asked for ${ageText(silent_s)}. See whether it is on and reaches the service.`;
      found.push({ id: `silent:${robot.name}`, text });
    }
    return found;
  });
}

export function ageText(seconds: number): string {
  const whole = Math.max(0, Math.floor(seconds));
  return whole < 120 ? `${whole} s` : `${Math.floor(whole / 60)} min`;
}
