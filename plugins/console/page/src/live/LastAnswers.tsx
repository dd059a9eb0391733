// The last answers, the newest first. A row moves the camera to its pose.

import { chance, clock } from "../ui/text";
import { Verdict } from "../ui/Verdict";
import { nameOf } from "./robotsOf";
import type { Fix } from "./seconds";

const SHOWN_ROWS = 30;

export interface LastAnswersProps {
  fixes: Fix[];
  look: (position: readonly number[]) => void;
}

export function LastAnswers({ fixes, look }: LastAnswersProps) {
  return (
    <table class="fixes" tabIndex={0}>
      <thead>
        <tr>
          <th>Time</th>
          <th>Robot</th>
          <th>Verdict</th>
          <th class="number">Probability</th>
          <th class="number">ms</th>
        </tr>
      </thead>
      <tbody>
        {fixes
          .slice(-SHOWN_ROWS)
          .reverse()
          .map((fix) => (
            <tr
              key={fix.number}
              title={`${fix.caller}, replica ${fix.replica}`}
              onClick={() => fix.answer.T_map_sensor && look(fix.answer.T_map_sensor.position)}
            >
              <td>{clock(fix.time_s * 1000)}</td>
              <td>{nameOf(fix)}</td>
              <td>
                <Verdict verdict={fix.answer.verdict} />
              </td>
              <td class="number">{chance(fix.answer.probability)}</td>
              <td class="number">{fix.ms.toFixed(0)}</td>
            </tr>
          ))}
      </tbody>
    </table>
  );
}
