import { useSignal } from "@preact/signals";
import { note } from "../router";

/** A link to this view: camera, colour, storey, layers, and the version even when another one answers later. */
export function ShareLink({ version }: { version: string }) {
  const link = useSignal("");
  const isCopied = useSignal(false);
  const share = async () => {
    note({ version });
    link.value = location.href;
    try {
      await navigator.clipboard.writeText(link.value);
      isCopied.value = true;
    } catch {
      isCopied.value = false; // over plain HTTP: it can be copied by hand
    }
  };
  return (
    <>
      <button onClick={share}>Link to this view</button>
      {link.value ? (
        <label>
          {isCopied.value ? "Copied" : "Copy this"}
          <input readOnly value={link.value} onFocus={(event) => event.currentTarget.select()} />
        </label>
      ) : null}
    </>
  );
}
