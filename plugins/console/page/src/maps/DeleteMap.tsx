// Deleting a map, after its name was typed.

import { deleteMap } from "../api/maps";
import { Confirm } from "../ui/Confirm";

export function DeleteMap({ map, close, done }: { map: string; close: () => void; done: () => void }) {
  const remove = async () => {
    await deleteMap(map);
    done();
  };
  return (
    <Confirm
      title={`Delete the map ${map}`}
      action="Delete"
      keep="Keep it"
      typed={{ name: "the map's name", text: map }}
      act={remove}
      close={close}
    >
      <p>All its versions are taken out of service. The next garbage collection removes their files for good.</p>
    </Confirm>
  );
}
