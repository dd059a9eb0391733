// Which recorded queries are shown. The choice is in the address, so that a link to it shows the same.

import type { Schemas } from "../api/client";
import { go, route } from "../router";
import { reason, REASON_CODES } from "../ui/text";

const VERDICTS: Schemas["Verdict"][] = ["localized", "ambiguous", "rejected"];

export interface Filter {
  map_id: string;
  verdict: Schemas["Verdict"] | undefined; // of all
  reason: string;
}

export function filterOf(query: URLSearchParams): Filter {
  const verdict = VERDICTS.find((one) => one === query.get("verdict"));
  return { map_id: query.get("map") ?? "", verdict, reason: query.get("reason") ?? "" };
}

export function Filters({ maps }: { maps: string[] }) {
  const filter = filterOf(route.value.query);
  const choose = (name: string, value: string) => {
    const query = new URLSearchParams(route.value.query);
    value ? query.set(name, value) : query.delete(name);
    go(["recorded-queries"], Object.fromEntries(query));
  };
  return (
    <>
      <Choice name="Map" value={filter.map_id} options={maps} choose={(value) => choose("map", value)} />
      <Choice name="Verdict" value={filter.verdict ?? ""} options={VERDICTS} choose={(value) => choose("verdict", value)} />
      <Choice
        name="Why"
        value={filter.reason}
        options={REASON_CODES}
        text={reason}
        choose={(value) => choose("reason", value)}
      />
    </>
  );
}

interface ChoiceProps {
  name: string;
  value: string;
  options: string[];
  text?: (option: string) => string;
  choose: (value: string) => void;
}

function Choice({ name, value, options, text = String, choose }: ChoiceProps) {
  return (
    <label>
      {name}
      <select value={value} onChange={(event) => choose(event.currentTarget.value)}>
        <option value="">All</option>
        {options.map((one) => (
          <option key={one} value={one}>
            {text(one)}
          </option>
        ))}
      </select>
    </label>
  );
}
