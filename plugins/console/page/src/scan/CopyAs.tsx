import { useSignal } from "@preact/signals";
import { asCpp, asCurl, asPython, type CopiedQuery } from "./copyAs";
import { copy } from "../ui/copy";

/** The query for other programs: shown, and copied where the browser allows it. */
export function CopyAs(query: CopiedQuery) {
  const shown = useSignal("");
  const isCopied = useSignal(false);
  const forms: Record<string, string | null> = { curl: asCurl(query), Python: asPython(query), "C++": asCpp(query) };
  const show = async (name: string, text: string) => {
    shown.value = name;
    isCopied.value = false;
    try {
      await copy(text);
      isCopied.value = true;
    } catch {
      isCopied.value = false; // it can still be selected
    }
  };
  return (
    <section aria-label="The same query for other programs">
      <div class="row">
        {Object.entries(forms).map(([name, text]) =>
          text === null ? null : (
            <button key={name} onClick={() => show(name, text)}>
              Copy as {name}
            </button>
          ),
        )}
        <span role="status">{isCopied.value ? `${shown.value} copied` : ""}</span>
      </div>
      {shown.value ? (
        <pre class="code" tabIndex={0} aria-label={shown.value}>
          {forms[shown.value]}
        </pre>
      ) : null}
    </section>
  );
}
