// Each robot with its last answer and where it was last localized.

import { route } from "../router";
import { percent } from "../ui/text";
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
    <table class="robots">
      <thead>
        <tr>
          <th>Robot</th>
          <th>Last answer</th>
          <th class="number">Localized</th>
          <th>Last fix</th>
        </tr>
      </thead>
      <tbody>
        {robots.map((one) => (
          <Row
            key={`${one.caller} ${one.name}`}
            robot={one}
            now_s={now_s}
            isShown={shown.endsWith(`:${one.name}`)}
            look={look}
          />
        ))}
      </tbody>
    </table>
  );
}

function Row({ robot, now_s, isShown, look }: { robot: Robot; now_s: number; isShown: boolean; look: RobotsProps["look"] }) {
  const { name, caller, last, lastFix } = robot;
  const pose = lastFix?.answer.T_map_sensor;
  return (
    <tr class={isShown ? "shown-robot" : ""}>
      <th scope="row">
        {name}
        {caller === name ? null : <small title={caller}>{caller}</small>}
      </th>
      <td>
        <Verdict verdict={last.answer.verdict} /> <small>{ageText(now_s - last.time_s)} ago</small>
      </td>
      <td class="number">
        {percent(robot.localized / robot.answers)}
        <small>
          {robot.localized} of {robot.answers}
        </small>
      </td>
      <td>
        {lastFix && pose ? (
          <button
            title={lastFix.answer.fix_id ? `fix ${lastFix.answer.fix_id}` : undefined}
            onClick={() => look(pose.position)}
          >
            {pose.position.slice(0, 2).map((m) => m.toFixed(1)).join(", ")} m
          </button>
        ) : (
          "none yet"
        )}
      </td>
    </tr>
  );
}
