// The map as a file for other viewers, with the newest recorded queries where the caller may see them.

import { useSignal } from "@preact/signals";
import { mayBuild } from "../access/session";
import type { Schemas } from "../api/client";
import { viewerFile, viewerFormats } from "../api/maps";
import { save } from "../ui/save";
import { ErrorText } from "../ui/ErrorText";
import { short } from "../ui/text";
import { useLoaded } from "../ui/useLoaded";

type Format = Schemas["ViewerFormat"];
const QUERIES = 20; // the newest recorded ones

export function ViewerFiles({ map, version }: { map: string; version: string }) {
  const formats = useLoaded(viewerFormats, []);
  const made = useSignal("");
  const problem = useSignal<unknown>(null);
  const download = async ({ format }: Format) => {
    problem.value = null;
    made.value = format;
    try {
      save(await viewerFile(map, version, format, mayBuild.value ? QUERIES : 0), `${map}-${short(version)}.${format}`);
    } catch (error) {
      problem.value = error;
    }
    made.value = "";
  };
  return (
    <section aria-label="Files for other viewers">
      <h3>Open in another viewer</h3>
      {(formats.value ?? []).map((one) => (
        <div key={one.format}>
          <button disabled={one.remedy !== "" || made.value !== ""} onClick={() => download(one)}>
            {made.value === one.format ? "Making the file …" : `Download .${one.format}`}
          </button>{" "}
          <small>for {one.opened_by}{one.remedy ? `. Here ${one.remedy}` : ""}</small>
        </div>
      ))}
      {formats.error ? <ErrorText error={formats.error} again={formats.again} /> : null}
      {problem.value ? <ErrorText error={problem.value} /> : null}
    </section>
  );
}
