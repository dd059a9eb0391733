// API keys: give one out, see who has one, take one back.

import { useSignal } from "@preact/signals";
import { keyList, revokeKey } from "../api/access";
import type { Schemas } from "../api/client";
import { Confirm } from "../ui/Confirm";
import { Empty } from "../ui/Empty";
import { ErrorText } from "../ui/ErrorText";
import { useLoaded } from "../ui/useLoaded";
import { When } from "../ui/When";
import { MakeKey } from "./MakeKey";
import { NobodyAsked } from "./NobodyAsked";

export function KeysView() {
  const keys = useLoaded(keyList, []);
  const isMaking = useSignal(false);
  const doomed = useSignal<Schemas["Key"] | null>(null);
  const revoke = async (id: string) => {
    await revokeKey(id);
    keys.again();
  };
  if (keys.error) return <ErrorText error={keys.error} again={keys.again} />;
  if (!keys.value) return <p role="status">Reading the keys …</p>;
  return (
    <main class="page">
      <header class="row">
        <h1>API keys</h1>
        <button class="primary" onClick={() => (isMaking.value = true)}>
          Make a key
        </button>
      </header>
      <NobodyAsked />
      {keys.value.keys.length ? (
        <Table keys={keys.value.keys} revoke={(one) => (doomed.value = one)} />
      ) : (
        <Empty title="No key yet">
          <p>Make one for each robot and each person, so that one can be taken back alone.</p>
        </Empty>
      )}
      {doomed.value ? (
        <Confirm
          title={`Revoke the key of ${doomed.value.name}`}
          action="Revoke"
          keep="Keep it"
          typed={{ name: "the name of its owner", text: doomed.value.name }}
          act={() => revoke(doomed.value!.key_id)}
          close={() => (doomed.value = null)}
        >
          <p>
            Whoever uses this key is refused within seconds: robots with it are not answered any more. It cannot be given
            back, and its token cannot be shown again.
          </p>
        </Confirm>
      ) : null}
      {isMaking.value ? (
        <MakeKey
          close={() => {
            isMaking.value = false;
            keys.again();
          }}
        />
      ) : null}
    </main>
  );
}

function Table({ keys, revoke }: { keys: Schemas["Key"][]; revoke: (one: Schemas["Key"]) => void }) {
  return (
    <table class="cards">
      <thead>
        <tr>
          <th>Name</th>
          <th>Id</th>
          <th>Scopes</th>
          <th>Maps</th>
          <th>Made</th>
          <th>Expires</th>
          <th />
        </tr>
      </thead>
      <tbody>
        {keys.map((one) => (
          <tr key={one.key_id}>
            <th scope="row">{one.name}</th>
            <td data-name="Id">
              <code>{one.key_id}</code>
            </td>
            <td data-name="Scopes">{one.scopes.join(", ")}</td>
            <td data-name="Maps">{one.maps.join(", ")}</td>
            <td data-name="Made">
              <When iso={one.created_time} />
            </td>
            <td data-name="Expires">{one.expires_time ? new Date(one.expires_time).toLocaleDateString("en-GB") : "never"}</td>
            <td class="actions">
              {one.revoked ? (
                <span class="tag">revoked</span>
              ) : (
                <button onClick={() => revoke(one)} aria-label={`Revoke the key of ${one.name}`}>
                  Revoke
                </button>
              )}
            </td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}
