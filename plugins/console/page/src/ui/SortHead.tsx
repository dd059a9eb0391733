import type { ComponentChildren } from "preact";

export interface SortHeadProps {
  isSorted: boolean;
  isDown: boolean;
  sort: () => void; // by this column; again: the other way round
  isNumber?: boolean;
  children: ComponentChildren;
}

/** The head of a column by which a table can be sorted. */
export function SortHead({ isSorted, isDown, sort, isNumber, children }: SortHeadProps) {
  return (
    <th class={isNumber ? "number" : ""} aria-sort={isSorted ? (isDown ? "descending" : "ascending") : undefined}>
      <button class="sort" onClick={sort}>
        {children}
        <span aria-hidden="true">{isSorted ? (isDown ? " ↓" : " ↑") : ""}</span>
      </button>
    </th>
  );
}
