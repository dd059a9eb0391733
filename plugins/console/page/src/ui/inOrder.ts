// The order of a table's rows.

type Key = string | number | null | undefined;

/** The rows by their keys. What has none stands last, whichever way round. */
export function inOrder<Row>(rows: readonly Row[], keyOf: (row: Row) => Key, isDown: boolean): Row[] {
  return rows
    .map((row) => ({ row, key: keyOf(row) ?? null }))
    .sort((a, b) => {
      if (a.key === null || b.key === null) return Number(a.key === null) - Number(b.key === null);
      const order = a.key < b.key ? -1 : a.key > b.key ? 1 : 0;
      return isDown ? -order : order;
    })
    .map(({ row }) => row);
}
