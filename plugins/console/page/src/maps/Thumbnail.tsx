import { useEffect, useState } from "preact/hooks";
import { thumbnail } from "../api/maps";

/** The map from above, in the colours of its picture in 3D. Its place is there before it. `version`: null: there is none. */
export function Thumbnail({ map, version }: { map: string; version: string | null }) {
  const [address, setAddress] = useState("");
  useEffect(() => {
    if (!version) return;
    const stop = new AbortController();
    let made = "";
    thumbnail(map, version, stop.signal)
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
  return <span class="thumbnail">{address ? <img src={address} alt="" /> : null}</span>;
}
