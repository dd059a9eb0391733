// Colours for pictures, from the tokens of style.css: the one place that has them.

/** The colour of a token that is the same on light and dark ground, as three.js counts it: token("ground-of-map"). */
export function token(name: string): number {
  const text = tokenText(name);
  const digits = /^#(?:[0-9a-f]{3}|[0-9a-f]{6})$/.test(text) ? text.slice(1) : null; // the build shortens pairs of digits
  if (digits === null) throw new Error(`--${name} is no token of one colour: "${text}"`);
  return parseInt(digits.length === 3 ? digits.replace(/./g, "$&$&") : digits, 16);
}

/** A token as the style sheet has it, for what takes colours as a style sheet does. */
export function tokenText(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}
