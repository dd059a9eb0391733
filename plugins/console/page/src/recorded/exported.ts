// Recorded queries whose truth is known, as a test set that `firstfix evaluate` reads: scans and poses.csv in a zip.

import type { Schemas } from "../api/client";
import { recordedBody, recordedPage } from "../api/scans";
import type { MapFile } from "../maps/files";
import { zipped } from "../maps/zip";
import { suffixOf } from "../scan/media";
import { save } from "../ui/save";

/** Collects the recorded queries of a map and offers the zip to be saved. */
export async function exported(map: string, told: (share: number) => void): Promise<void> {
  const found: Schemas["RecordedQueryDetails"][] = [];
  let after: string | null = null;
  do {
    const page: Schemas["RecordedQueryPage"] = await recordedPage({ map_id: map, after, limit: 1000 });
    found.push(...page.queries.filter((one) => one.truth?.map_id === map && suffixOf(one.media_type) && !one.content_encoding));
    after = page.next;
  } while (after);
  if (!found.length) throw new Error("No recorded query of this map has a truth yet: look at one and mark where it was.");
  const rows = ["scan,tx,ty,tz,qx,qy,qz,qw"];
  const files: MapFile[] = [];
  for (const [i, recorded] of found.entries()) {
    const name = `${recorded.query_id}${suffixOf(recorded.media_type)}`;
    const body = await recordedBody(recorded.query_id);
    files.push({ path: name, file: new File([body], name) });
    const pose = recorded.truth!.T_map_sensor;
    rows.push([name, ...(pose ? [...pose.position, ...pose.quaternion] : Array<string>(7).fill(""))].join(","));
    told((i + 1) / found.length);
  }
  files.push({ path: "poses.csv", file: new File([`${rows.join("\n")}\n`], "poses.csv") });
  save(await zipped(files), `${map}-test-set.zip`);
}
