// Calls of the service: one place that knows its address, the caller's key and the form of its errors.

import createClient from "openapi-fetch";
import { key, refused } from "../access/session";
import { patiently } from "./patience";
import type { components, paths } from "./schema";

export type Schemas = components["schemas"];

/** An answer of the service that is not a success, with the service's own text. */
export class Problem extends Error {
  constructor(
    readonly status: number,
    readonly code: string,
    detail: string,
    /** The map that was meant, where there is none of the name. */
    readonly nearest = "",
  ) {
    super(detail);
  }
}

// The page lies one level below the service: at "console/".
const ROOT = new URL("..", document.baseURI);

export function addressOf(path: string, query: Record<string, string | number | boolean | null | undefined> = {}): URL {
  const url = new URL(path.replace(/^\//, ""), ROOT);
  for (const [name, value] of Object.entries(query)) {
    if (value !== undefined && value !== null && value !== "") url.searchParams.set(name, String(value));
  }
  return url;
}

function isGiven(parameter: [string, unknown]): parameter is [string, string | number | boolean] {
  return ["string", "number", "boolean"].includes(typeof parameter[1]);
}

/** The calls of openapi.json, each with its own types. */
export const api = createClient<paths>({
  baseUrl: String(ROOT),
  querySerializer: (query) => addressOf("", Object.fromEntries(Object.entries(query).filter(isGiven))).search.slice(1),
  fetch: (request) => send(request, request.method === "GET" || request.method === "HEAD"),
});

/** For a POST that changes nothing: it may be sent again. */
export function asRead(request: Request): Promise<Response> {
  return send(request, true);
}

/** The content of an answer. One that is no success has failed before, in the service's words. */
export async function said<T>(call: Promise<{ data?: T }>): Promise<T> {
  const { data } = await call;
  if (data === undefined) throw new Problem(0, "unknown", "The service gave an empty answer.");
  return data;
}

/** Sends a request, and returns the answer if it is a success. A read waits if the service asks for it. */
async function send(request: Request, isRead: boolean): Promise<Response> {
  const { method, headers, signal } = request;
  const content = await request.blob();
  const given = key.value;
  if (given) headers.set("Authorization", `Bearer ${given}`);
  const body = content.size ? content : undefined;
  const ask = () => fetch(new URL(request.url), { method, headers, body, signal, credentials: "omit" });
  let response: Response;
  try {
    response = await (isRead ? patiently(ask, signal) : ask());
  } catch (error) {
    if (error instanceof DOMException && error.name === "AbortError") throw error;
    throw new Problem(0, "unreachable", "The service cannot be reached.");
  }
  if (response.ok) return response;
  const problem = await problemOf(response);
  if (problem.status === 401) refused(given, problem);
  throw problem;
}

async function problemOf(response: Response): Promise<Problem> {
  try {
    const said = (await response.json()) as { code?: string; detail?: string; title?: string; nearest?: string };
    const detail = said.detail ?? said.title ?? response.statusText;
    return new Problem(response.status, said.code ?? "unknown", detail, said.nearest);
  } catch {
    return new Problem(response.status, "unknown", response.statusText || `status ${response.status}`);
  }
}
