import { caller } from "./session";

/** A warning where the service asks nobody for a key. */
export function NobodyAsked() {
  if (caller.value?.authentication !== false) return null;
  return (
    <div class="error" role="note">
      <p>
        <strong>Authentication is off.</strong> Everybody who reaches this address may build, activate and delete maps. Keys
        that are made now are asked for only once the service runs with <code>FIRSTFIX_AUTH=on</code>.
      </p>
    </div>
  );
}
