// What can be done with the versions of a map, and what it means for the robots.

import { activateVersion, retireVersion, rollBack } from "../api/maps";
import type { Question } from "../ui/Confirm";
import { short } from "../ui/text";

export type Change = { kind: "activate" | "retire"; version: string } | { kind: "rollback" };

export interface ChangeCall extends Question {
  text: string; // what happens
  told: string; // when it is done
  isFelt: boolean; // whether robots are answered otherwise from then on
}

export function callOf(map: string, change: Change, active: string): ChangeCall {
  const now = active ? short(active) : "none";
  if (change.kind === "rollback") {
    return {
      act: () => rollBack(map),
      title: `Roll back ${map}`,
      action: "Roll back",
      keep: `Stay with ${now}`,
      text: `The version that was active before ${now} answers all robots that ask ${map}, from their next query on.`,
      told: "Rolled back",
      isFelt: true,
    };
  }
  const name = short(change.version);
  if (change.kind === "activate") {
    return {
      act: () => activateVersion(map, change.version),
      title: `Activate ${name}`,
      action: "Activate",
      keep: `Stay with ${now}`,
      text: `${name} answers all robots that ask ${map}, from their next query on, in place of ${now}. Roll back undoes it.`,
      told: "Activated",
      isFelt: true,
    };
  }
  return {
    act: () => retireVersion(map, change.version),
    title: `Retire ${name}`,
    action: "Retire",
    keep: "Keep it",
    text: "It cannot be activated or rolled back to any more. The next garbage collection removes its files for good.",
    told: "Retired",
    typed: { name: "the version", text: name },
    isFelt: false,
  };
}
