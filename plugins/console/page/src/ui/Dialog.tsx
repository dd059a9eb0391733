import type { ComponentChildren } from "preact";
import { useLayoutEffect, useRef } from "preact/hooks";

/** A modal dialog. Escape closes it, the focus stays within, and goes back to where it was. */
export function Dialog({
  title,
  close,
  children,
}: {
  title: string;
  close: () => void;
  children: ComponentChildren;
}) {
  const element = useRef<HTMLDialogElement>(null);
  const isGone = useRef(false);
  useLayoutEffect(() => {
    const dialog = element.current!;
    dialog.showModal();
    return () => {
      isGone.current = true;
      dialog.close(); // the browser gives the focus back, but not from a dialog that is taken away open
    };
  }, []);
  return (
    <dialog ref={element} onClose={() => isGone.current || close()} aria-label={title}>
      <h2>{title}</h2>
      {children}
    </dialog>
  );
}
