import { age, moment } from "./text";

/** When something was, as a day and a time, and how long ago. */
export function When({ iso }: { iso: string }) {
  return (
    <time class="when" dateTime={iso} title={iso}>
      {moment(iso)} <small>{age(iso)}</small>
    </time>
  );
}
