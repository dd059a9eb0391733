// Each robot with its last fix.

import { route } from "../router";
import { chance, percent } from "../ui/text";
import { Verdict } from "../ui/Verdict";
import { ageText, type Robot } from "./robotsOf";

export interface RobotsProps {
  robots: Robot[];
  now_s: number;
  look: (position: readonly number[]) => void;
}

export function Robots({ robots, now_s, look }: RobotsProps) {
  if (!robots.length) return null;
  const shown = route.value.query.get("alert") ?? "";
  return (
    <table class="robots cards">
      <thead>
        <tr>
          <th>Robot</th>
          <th>Last asked</th>
          <th>Verdict</th>
          <th class="number">Localized</th>
          <th>Last fix</th>
          <th class="number">Probability</th>
          <th class="number">ms</th>
        </tr>
      </thead>
      <tbody>
        {robots.map((one) => (
          <Row key={one.name} robot={one} now_s={now_s} isShown={shown.endsWith(`:${one.name}`)} look={look} />
        ))}
      </tbody>
    </table>
  );
}

function Row({ robot, now_s, isShown, look }: { robot: Robot; now_s: number; isShown: boolean; look: RobotsProps["look"] }) {
  const { last, lastFix } = robot;
  const pose = lastFix?.answer.T_map_sensor;
  return (
    <tr class={isShown ? "shown-robot" : ""}>
      <th scope="row">{robot.name}</th>
      <td data-name="Last asked">{ageText(now_s - last.time_s)} ago</td>
      <td data-name="Verdict">
        <Verdict verdict={last.answer.verdict} />
      </td>
      <td class="number" data-name="Localized">
        {robot.localized} of {robot.answers}, {percent(robot.localized / robot.answers)}
      </td>
      <td data-name="Last fix">
        {lastFix && pose ? (
          <button onClick={() => look(pose.position)}>
            {ageText(now_s - lastFix.time_s)} ago at {pose.position.map((m) => m.toFixed(1)).join(", ")} m
            {lastFix.answer.fix_id ? `, fix ${lastFix.answer.fix_id.slice(0, 8)}` : ""}
          </button>
        ) : (
          "none yet"
        )}
      </td>
      <td class="number" data-name="Probability">{chance(last.answer.probability)}</td>
      <td class="number" data-name="ms">{last.ms.toFixed(0)}</td>
    </tr>
  );
}
