// Calls of the service: one place that knows its address, the caller's key and the form of its errors.

import createClient from "openapi-fetch";
import { key, refused } from "../access/session";
import { patiently } from "./patience";
import type { components, paths } from "./schema";

export type Schemas = components["schemas"];
export type Query = Record<string, string | number | boolean | null | undefined>;

/** An answer of the service that is not a success, with the service's own text. */
export class Problem extends Error {
  constructor(
    readonly status: number,
    readonly code: string,
    detail: string,
  ) {
    super(detail);
  }
}

export interface CallOptions {
  query?: Query;
  json?: unknown;
  body?: BodyInit;
  headers?: Record<string, string>;
  signal?: AbortSignal;
  isRead?: boolean; // it changes nothing, so it may be sent again; as GET and HEAD
}

// The page lies one level below the service: at "console/".
const ROOT = new URL("..", document.baseURI);

export function addressOf(path: string, query: Query = {}): URL {
  const url = new URL(path.replace(/^\//, ""), ROOT);
  for (const [name, value] of Object.entries(query)) {
    if (value !== undefined && value !== null && value !== "") url.searchParams.set(name, String(value));
  }
  return url;
}

/** Sends a request, and returns the answer if it is a success. A read waits if the service asks for it. */
export async function send(method: string, path: string, options: CallOptions = {}): Promise<Response> {
  const headers = new Headers(options.headers);
  const given = key.value;
  if (given) headers.set("Authorization", `Bearer ${given}`);
  let body = options.body;
  if (options.json !== undefined) {
    headers.set("Content-Type", "application/json");
    body = JSON.stringify(options.json);
  }
  const { signal, isRead = method === "GET" || method === "HEAD" } = options;
  const ask = () => fetch(addressOf(path, options.query), { method, headers, body, signal, credentials: "omit" });
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

export async function get<T>(path: string, query: Query = {}, signal?: AbortSignal): Promise<T> {
  return (await send("GET", path, { query, signal })).json() as Promise<T>;
}

export async function change<T>(method: string, path: string, options: CallOptions = {}): Promise<T> {
  const response = await send(method, path, options);
  return (response.status === 204 ? undefined : await response.json()) as T;
}

function isGiven(parameter: [string, unknown]): parameter is [string, string | number | boolean] {
  return ["string", "number", "boolean"].includes(typeof parameter[1]);
}

/** The calls of openapi.json, each with its own types. They are sent as all others are. */
export const api = createClient<paths>({
  baseUrl: String(ROOT),
  querySerializer: (query) => addressOf("", Object.fromEntries(Object.entries(query).filter(isGiven))).search.slice(1),
  fetch: async (request) => {
    const body = await request.blob();
    const { method, headers, signal } = request;
    return send(method, request.url, { headers: Object.fromEntries(headers), body: body.size ? body : undefined, signal });
  },
});

/** The content of an answer. One that is no success has failed before, in the service's words. */
export async function said<T>(call: Promise<{ data?: T }>): Promise<T> {
  const { data } = await call;
  if (data === undefined) throw new Problem(0, "unknown", "The service gave an empty answer.");
  return data;
}

async function problemOf(response: Response): Promise<Problem> {
  try {
    const said = (await response.json()) as { code?: string; detail?: string; title?: string };
    return new Problem(response.status, said.code ?? "unknown", said.detail ?? said.title ?? response.statusText);
  } catch {
    return new Problem(response.status, "unknown", response.statusText || `status ${response.status}`);
  }
}
