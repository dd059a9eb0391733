// Server-sent events over fetch: the browser's own EventSource cannot send the caller's key.

import { againAndAgain } from "./patience";

type Stream = NonNullable<Response["body"]>;

export interface ServerEvent {
  name: string;
  id: string;
  data: unknown;
}

/** Reads a stream of events until it ends. */
async function* events(stream: Stream): AsyncGenerator<ServerEvent> {
  const reader = stream.pipeThrough(new TextDecoderStream()).getReader();
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
  open: () => Promise<Stream | null>,
  take: (event: ServerEvent) => void,
  signal: AbortSignal,
  failed: (error: unknown) => void = () => {},
): Promise<void> {
  const read = async () => {
    const stream = await open();
    if (!stream) return;
    for await (const event of events(stream)) take(event);
  };
  return againAndAgain(read, signal, failed);
}
