// Who is signed in. The key stays in this tab alone, and goes with it.

import { computed, signal } from "@preact/signals";
import type { components } from "../api/schema";

const PLACE = "firstfix.key";

export const key = signal(sessionStorage.getItem(PLACE) ?? "");
export const caller = signal<components["schemas"]["Caller"] | null>(null);
export const refusal = signal<unknown>(null); // why the last key is not taken any more
export const mayBuild = computed(() => may("build"));
export const mayAdminister = computed(() => may("admin"));

function may(scope: string): boolean {
  return caller.value !== null && !caller.value.read_only && caller.value.scopes.includes(scope);
}

export function signIn(given: string, keep: boolean): void {
  refusal.value = null;
  key.value = given;
  if (keep) sessionStorage.setItem(PLACE, given);
}

/** The service refused a request with this key. The address stays, so signing in leads back to the view. */
export function refused(given: string, why: unknown): void {
  if (given !== key.value) return; // an answer to somebody who is not signed in any more
  if (given || caller.value) refusal.value = why;
  signOut();
}

export function signOut(): void {
  sessionStorage.removeItem(PLACE);
  key.value = "";
  caller.value = null;
}
