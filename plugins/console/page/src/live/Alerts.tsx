// What needs a person now. Each alert has a link of its own, and one to where it is dealt with.

import { link, route } from "../router";
import { ErrorText } from "../ui/ErrorText";
import type { Alert } from "./robotsOf";
import { useMapAlerts } from "./useMapAlerts";

export interface AlertsProps {
  map: string;
  ofRobots: Alert[];
  now_s: number;
}

export function Alerts({ map, ofRobots, now_s }: AlertsProps) {
  const { alerts: ofMap, error } = useMapAlerts(map, now_s);
  const alerts = [...ofRobots, ...(ofMap ?? [])];
  const shown = route.value.query.get("alert") ?? "";
  const isOver = shown !== "" && ofMap !== null && !alerts.some((one) => one.id === shown);
  if (!ofMap && error) return <ErrorText error={error} />;
  if (!alerts.length && !isOver) return null;
  return (
    <section class="alerts" aria-label="Alerts">
      <h2>Needs you now</h2>
      <ul>
        {alerts.map((one) => (
          <li key={one.id}>
            <a href={link(["live"], { map, alert: one.id })} aria-current={one.id === shown ? "true" : undefined}>
              {one.text}
            </a>{" "}
            {one.look ? <a href={one.look}>Look</a> : null}
          </li>
        ))}
        {isOver ? <li>The alert of this link, {shown}, is over.</li> : null}
      </ul>
    </section>
  );
}
