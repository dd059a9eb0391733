import { useEffect, useState } from "preact/hooks";
import { versionPreview } from "../api/maps";

/** The picture of a version, as its build made it. */
export function Preview({ map, version }: { map: string; version: string }) {
  const [address, setAddress] = useState("");
  useEffect(() => {
    const stop = new AbortController();
    let made = "";
    versionPreview(map, version, stop.signal)
      .then((picture) => {
        if (stop.signal.aborted) return;
        made = URL.createObjectURL(picture);
        setAddress(made);
      })
      .catch(() => {}); // the list says what matters without it
    return () => {
      stop.abort();
      if (made) URL.revokeObjectURL(made);
    };
  }, [map, version]);
  return address ? <img src={address} alt={`${map} from above`} /> : null;
}
