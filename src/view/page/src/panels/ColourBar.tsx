/** The colour bar below the image, with label, unit and ticks. */

import { useEffect, useRef } from "preact/hooks";
import type { Legend } from "../display/legend";

const unitText = (unit: string): string => (unit === "" || unit === "1" ? "" : ` [${unit}]`);

/** Returns the label of a legend with its unit. */
export const legendTitle = ({ label, unit, scale }: Legend): string =>
  label + unitText(unit) + (scale === "linear" ? "" : `, ${scale === "arctan" ? "arctan" : "symmetric log"} scale`);

export function ColourBar({ legend }: { legend: Legend }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const context = canvas.current!.getContext("2d")!;
    const data = context.createImageData(256, 1);
    for (let k = 0; k < 256; k++) data.data.set([...legend.map.subarray(3 * k, 3 * k + 3), 255], 4 * k);
    context.putImageData(data, 0, 0);
  }, [legend.map]);
  return (
    <div class="colour-bar" role="img" aria-label={`Colour bar: ${legendTitle(legend)}, from ${legend.low} to ${legend.high}`}>
      <span class="colour-bar-label">{legendTitle(legend)}</span>
      <span class="colour-bar-scale">
        <canvas ref={canvas} width={256} height={1} />
        {legend.ticks.map((tick) => (
          <span class="tick" key={tick.label} style={{ left: `${100 * tick.at}%` }}>{tick.label}</span>
        ))}
      </span>
    </div>
  );
}
