// Server-sent events over fetch: the browser's own EventSource cannot send the caller's key.

import { type Query, send } from "./client";
import { againAndAgain } from "./patience";

export interface ServerEvent {
  name: string;
  id: string;
  data: unknown;
}

/** Reads a stream of events until it ends or is aborted. */
export async function* events(path: string, query: Query, signal: AbortSignal): AsyncGenerator<ServerEvent> {
  const response = await send("GET", path, { query, signal });
  const reader = response.body!.pipeThrough(new TextDecoderStream()).getReader();
  let waiting = "";
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    const blocks = (waiting + value).split("\n\n");
    waiting = blocks.pop() ?? "";
    for (const block of blocks) {
      const event = parse(block);
      if (event) yield event;
    }
  }
}

function parse(block: string): ServerEvent | null {
  const fields = new Map<string, string>();
  for (const line of block.split("\n")) {
    const [, name, value] = /^(\w+): (.*)$/.exec(line) ?? [];
    if (name) fields.set(name, value ?? "");
  }
  const data = fields.get("data");
  if (data === undefined) return null;
  return { name: fields.get("event") ?? "message", id: fields.get("id") ?? "", data: JSON.parse(data) };
}

/** Calls `take` with every event, and opens the stream again when it breaks, until aborted or refused for good. */
export function follow(
  path: string,
  query: () => Query,
  take: (event: ServerEvent) => void,
  signal: AbortSignal,
  failed: (error: unknown) => void = () => {},
): Promise<void> {
  const read = async () => {
    for await (const event of events(path, query(), signal)) take(event);
  };
  return againAndAgain(read, signal, failed);
}
