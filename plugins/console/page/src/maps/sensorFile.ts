// A sensor's description as YAML or JSON. The service checks what it says.

import { load } from "js-yaml";

const MAX_BYTES = 1e6;

export async function sensorOf(file: File): Promise<Record<string, unknown>> {
  if (file.size > MAX_BYTES) throw new Error(`${file.name} is larger than 1 MB: it does not describe a sensor.`);
  let found: unknown;
  try {
    found = load(await file.text());
  } catch (error) {
    throw new Error(`${file.name}: ${error instanceof Error ? error.message.split("\n")[0] : String(error)}`, { cause: error });
  }
  if (typeof found !== "object" || found === null || Array.isArray(found)) {
    throw new Error(`${file.name} does not describe a sensor: it has no names with values.`);
  }
  return found as Record<string, unknown>;
}
