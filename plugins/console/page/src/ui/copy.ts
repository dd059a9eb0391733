// Copying a text. Browsers offer their clipboard over TLS alone, and robots' networks seldom have it.

export async function copy(text: string): Promise<void> {
  if (isSecureContext) return navigator.clipboard.writeText(text);
  const paper = document.createElement("textarea");
  paper.value = text;
  const focused = document.activeElement;
  // outside of a modal dialog nothing can be selected
  (focused?.closest("dialog") ?? document.body).append(paper);
  paper.select();
  const isDone = document.execCommand("copy");
  paper.remove();
  if (focused instanceof HTMLElement) focused.focus();
  if (!isDone) throw new Error("The browser does not let the console copy.");
}
