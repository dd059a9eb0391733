// The same query for other programs: curl, Python, C++. Each sends the bytes of the file as they are.

import { addressOf } from "../api/client";
import type { LocalizeQuery } from "../api/scans";

export interface CopiedQuery {
  map: string;
  file: string;
  type: string;
  encoding: string; // of the content: gzip, zstd or none
  options: LocalizeQuery;
  isSignedIn: boolean; // without a key no header may be sent: an empty one is refused
}

export function asCurl({ map, file, type, encoding, options, isSignedIn }: CopiedQuery): string {
  const lines = [
    `curl ${shell(String(addressOf("/localize", { map, ...options })))}`,
    ...(isSignedIn ? [`-H "Authorization: Bearer $FIRSTFIX_API_KEY"`] : []),
    `-H ${shell(`Content-Type: ${type}`)}`,
    ...(encoding ? [`-H ${shell(`Content-Encoding: ${encoding}`)}`] : []),
    `--data-binary ${shell(`@${file}`)}`,
  ];
  return lines.join(" \\\n  ");
}

export function asPython({ map, file, type, encoding, options }: CopiedQuery): string {
  const given = Object.entries(options)
    .filter(([, value]) => value)
    .map(([name, value]) => `${text(name)}: ${text(value)}`);
  return `from pathlib import Path

from firstfix.answer.options import LocalizeOptions
from firstfix_client import Client

options = LocalizeOptions.from_strings({${given.join(", ")}})
with Client(${text(addressOf("/"))}) as client:
    body = Path(${text(file)}).read_bytes()
    answer = client.localize_body(
        body, ${text(type)}, map_id=${text(map)}, options=options${encoding ? `, content_encoding=${text(encoding)}` : ""}
    )
print(answer.verdict, answer.T_map_sensor)`;
}

/** Null: the client does not send bodies that are encoded once more. */
export function asCpp({ map, file, type, encoding, options }: CopiedQuery): string | null {
  if (encoding) return null;
  return `#include <firstfix/client.hpp>

#include <cstdio>
#include <fstream>
#include <iterator>

int main() {
  firstfix::Client client(${text(addressOf("/"))});
  std::ifstream file(${text(file)}, std::ios::binary);
  const firstfix::Bytes body{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  firstfix::LocalizeOptions options;
${cppOptions(options)}  const firstfix::Localization fix = client.localize_body(body, ${text(type)}, ${text(map)}, options);
  std::printf("%s %.3f\\n", firstfix::text_of(fix.verdict), fix.probability);
  if (fix.T_map_sensor) {
    const auto& at = fix.T_map_sensor->position;
    std::printf("%.3f %.3f %.3f\\n", at[0], at[1], at[2]);
  }
}`;
}

function cppOptions({ prior, gravity, min_probability, version }: LocalizeQuery): string {
  const lines = [];
  if (prior) {
    const [x, y, z, radius, ...heading] = String(prior).split(",");
    lines.push(`options.prior = firstfix::Prior{{${x}, ${y}, ${z}}, ${[radius, ...heading].join(", ")}};`);
  }
  if (gravity) {
    // The HTTP option takes roll and pitch as well; this client takes the direction.
    const [roll, pitch] = String(gravity)
      .split(",")
      .map((degrees) => (Number(degrees) * Math.PI) / 180) as [number, number];
    const down = [Math.sin(pitch), -Math.cos(pitch) * Math.sin(roll), -Math.cos(pitch) * Math.cos(roll)];
    lines.push(`options.gravity = {${down.map((part) => part.toFixed(9)).join(", ")}};`);
  }
  if (min_probability) lines.push(`options.min_probability = ${min_probability};`);
  if (version) lines.push(`options.version = ${text(version)};`);
  return lines.map((line) => `  ${line}\n`).join("");
}

/** A string literal of Python and of C++. */
function text(value: unknown): string {
  return JSON.stringify(String(value));
}

function shell(word: string): string {
  return `'${word.replaceAll("'", `'\\''`)}'`;
}
