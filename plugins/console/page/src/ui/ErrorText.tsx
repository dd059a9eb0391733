import { Problem } from "../api/client";

/** An error in the service's own words. */
export function ErrorText({ error, again }: { error: unknown; again?: () => void }) {
  const text = error instanceof Error ? error.message : String(error);
  const code = error instanceof Problem ? error.code : "";
  return (
    <div class="error" role="alert">
      <p>
        {text} {code ? <code>{code}</code> : null}
      </p>
      {again ? <button onClick={again}>Try again</button> : null}
    </div>
  );
}
