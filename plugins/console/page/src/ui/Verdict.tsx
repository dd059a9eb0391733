export function Verdict({ verdict }: { verdict: string }) {
  return <span class={`verdict ${verdict}`}>{verdict}</span>;
}
