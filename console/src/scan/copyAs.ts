// The same query for other programs: curl, Python, C++.

import { addressOf, type Query } from "../api/client";

export function asCurl(map: string, file: string, type: string, options: Query): string {
  const url = addressOf("/localize", { map, ...options });
  return `curl -X POST '${url}' \\\n  -H 'Authorization: Bearer '"$FIRSTFIX_KEY" \\\n  -H 'Content-Type: ${type}' \\\n  --data-binary @'${file}'`;
}

export function asPython(map: string, file: string, options: Query): string {
  const given = Object.entries(options)
    .filter(([, value]) => value)
    .map(([name, value]) => `"${name}": "${value}"`);
  const more = given.length ? `, options=LocalizeOptions.from_strings({${given.join(", ")}})` : "";
  return `from firstfix.answer.options import LocalizeOptions
from firstfix.decode import read_scan_file
from firstfix_client import Client

with Client("${addressOf("/")}") as client:
    answer = client.localize(read_scan_file("${file}"), map_id="${map}"${more})
print(answer.verdict, answer.T_map_sensor)`;
}
