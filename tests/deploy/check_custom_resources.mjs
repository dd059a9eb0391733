// What is wrong with resources of prometheus-operator: a JSON array of them on standard input, of problems on standard
// output. Argument: the folder of the npm package @kubernetes-models/prometheus-operator.
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const TYPES = "ComGithubPrometheusOperatorPrometheusOperatorPkgApisMonitoringV1";
const problems = [];
for (const resource of JSON.parse(readFileSync(0, "utf8"))) {
  const { validate } = await import(pathToFileURL(`${process.argv[2]}/_schemas/${TYPES}${resource.kind}.js`));
  const unread = new Map();
  if (!validate({ ...resource, spec: watched(resource.spec, "/spec", unread) })) {
    problems.push(...validate.errors.map((e) => `${resource.kind} ${e.instancePath}: ${e.message ?? e.schemaPath}`));
  }
  for (const [path, names] of unread) {
    problems.push(...[...names].map((name) => `${resource.kind} ${path}/${name}: no such field`));
  }
}
console.log(JSON.stringify(problems));

// The validators pass over fields that they do not know. They are known by this: nobody looks at them.
function watched(value, path, unread) {
  if (value === null || typeof value !== "object") return value;
  const copy = Array.isArray(value) ? [] : {};
  for (const name of Object.keys(value)) copy[name] = watched(value[name], `${path}/${name}`, unread);
  if (Array.isArray(value)) return copy;
  unread.set(path, new Set(Object.keys(value)));
  return new Proxy(copy, {
    get(target, name) {
      unread.get(path).delete(name);
      return target[name];
    },
    ownKeys(target) {
      unread.set(path, new Set()); // free names, such as labels
      return Reflect.ownKeys(target);
    },
  });
}
