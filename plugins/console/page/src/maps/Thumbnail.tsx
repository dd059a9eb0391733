import { useEffect, useState } from "preact/hooks";
import { thumbnail } from "../api/maps";

/** The map from above, in the colours of its picture in 3D. It has its place before it is there. */
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
      .catch(() => {}); // a provisional version has none: the list says what matters without it
    return () => {
      stop.abort();
      if (made) URL.revokeObjectURL(made);
    };
  }, [map, version]);
  return <span class="thumbnail">{address ? <img src={address} alt="" /> : null}</span>;
}
