// Each robot with its last fix, and what about it needs a person. Each alert has a link of its own.

import { link, route } from "../router";
import { chance, percent } from "../ui/text";
import { Verdict } from "../ui/Verdict";
import "./live.css";
import { ageText, alertsOf, type Robot } from "./robotsOf";

export interface RobotsProps {
  map: string;
  robots: Robot[];
  now_s: number;
  look: (position: readonly number[]) => void;
}

export function Robots({ map, robots, now_s, look }: RobotsProps) {
  if (!robots.length) return null;
  const alerts = alertsOf(robots, now_s);
  const shown = route.value.query.get("alert") ?? "";
  const isOver = shown !== "" && !alerts.some((one) => one.id === shown);
  return (
    <>
      {alerts.length || isOver ? (
        <section class="alerts" aria-label="Alerts">
          <h2>Needs you now</h2>
          <ul>
            {alerts.map((one) => (
              <li key={one.id}>
                <a href={link(["live"], { map, alert: one.id })} aria-current={one.id === shown ? "true" : undefined}>
                  {one.text}
                </a>
              </li>
            ))}
            {isOver ? <li>The alert of this link, {shown}, is over.</li> : null}
          </ul>
        </section>
      ) : null}
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
    </>
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
