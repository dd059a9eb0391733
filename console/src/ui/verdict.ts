const COLOURS: Record<string, number> = { localized: 0x34a853, ambiguous: 0xff9500, rejected: 0xff3b30 };

/** Colour of a verdict in pictures. */
export function colourOf(verdict: string): number {
  return COLOURS[verdict] ?? 0x888888;
}
