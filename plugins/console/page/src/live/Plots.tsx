// Three small plots of the last minutes.

import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { tokenText } from "../ui/token";
import type { Second } from "./seconds";

const HEIGHT = 110;

export function Plots({ seconds }: { seconds: Second[] }) {
  const time = seconds.map((one) => one.time_s);
  return (
    <div class="plots">
      <Plot
        title="Queries a second"
        names={["all", "localized"]}
        data={[time, seconds.map((one) => one.queries), seconds.map((one) => one.localized)]}
      />
      <Plot
        title="Milliseconds"
        names={["slowest", "median"]}
        data={[time, seconds.map((one) => one.slowest_ms), seconds.map((one) => one.median_ms)]}
      />
    </div>
  );
}

function Plot({ title, names, data }: { title: string; names: string[]; data: uPlot.AlignedData }) {
  const element = useRef<HTMLDivElement>(null);
  const plot = useRef<uPlot | null>(null);
  useEffect(() => {
    const holder = element.current!;
    const colours = [tokenText("plot-all"), tokenText("plot-some")];
    plot.current = new uPlot(
      {
        width: Math.max(holder.clientWidth, 200),
        height: HEIGHT,
        title,
        cursor: { show: false },
        legend: { show: false },
        axes: [{ show: false }, { size: 56, stroke: () => getComputedStyle(holder).color, grid: { stroke: tokenText("plot-grid") } }],
        scales: { y: { range: (_, __, high) => [0, Math.max(high ?? 0, 1)] } },
        series: [{}, ...names.map((label, i) => ({ label, stroke: colours[i], width: 1.5, spanGaps: false }))],
      },
      data,
      holder,
    );
    const sized = new ResizeObserver(() => plot.current?.setSize({ width: holder.clientWidth, height: HEIGHT }));
    sized.observe(holder);
    const scheme = matchMedia("(prefers-color-scheme: dark)");
    const recolour = () => plot.current?.redraw(); // the numbers of its axis have the page's colour
    scheme.addEventListener("change", recolour);
    return () => {
      sized.disconnect();
      scheme.removeEventListener("change", recolour);
      plot.current?.destroy();
    };
  }, []);
  useEffect(() => plot.current?.setData(data), [data]);
  return <div class="plot" ref={element} role="img" aria-label={`${title}: ${names.join(", ")}`} />;
}
