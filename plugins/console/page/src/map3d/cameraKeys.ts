// The keys of the picture. They work while the picture has the focus, and while nothing else has it.

export const CAMERA_KEYS: [string, string][] = [
  ["Arrow keys", "move the map"],
  ["Shift and arrow keys", "turn it"],
  ["+ and -", "come nearer and go away"],
  ["t", "look from above, north (y) up"],
  ["w", "look at the whole map"],
  ["?", "show this list"],
];
export const KEYS = "Arrow keys move it, with Shift they turn it, + and - come nearer and go away. ? lists all keys.";

export type KeyAction = "nearer" | "away" | "above" | "whole" | "list";
const ACTIONS: Record<string, KeyAction> = { "+": "nearer", "-": "away", t: "above", w: "whole", "?": "list" };

/** Calls `act` for each key that has an action. Returns what ends it. */
export function listen(canvas: HTMLCanvasElement, act: (action: KeyAction) => void): () => void {
  const own = (event: KeyboardEvent) => {
    const action = event.ctrlKey || event.metaKey || event.altKey ? undefined : ACTIONS[event.key];
    if (action) act(action);
  };
  const elsewhere = (event: KeyboardEvent) => {
    const isFree = event.target === document.body || (event.target as Element).id === "view";
    if (canvas !== document.querySelector(".map-canvas canvas")) return; // of two pictures, the first has them
    if (isFree && (ACTIONS[event.key] || event.key.startsWith("Arrow"))) canvas.dispatchEvent(new KeyboardEvent("keydown", event));
  };
  canvas.addEventListener("keydown", own);
  document.addEventListener("keydown", elsewhere);
  return () => {
    canvas.removeEventListener("keydown", own);
    document.removeEventListener("keydown", elsewhere);
  };
}
