/** The illumination: which projector pixels are on. */

import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { slice, store } from "../data";
import { isPinhole } from "../geometry";
import { type Slice, type Store, axisOf } from "../model";
import { illuminationPattern, resolvesProjector } from "../request";
import { type Illumination, state, update } from "../state";
import { NumberField, Panel, Slider } from "./Field";
import { MapCanvas } from "./MapCanvas";
import { SliceButtons } from "./showSlice";

/** Blocks along the longer side of a drawing. */
const BLOCKS = 16;

type Drawn = Extract<Illumination, { kind: "drawn" }>;

const KINDS: readonly { kind: Illumination["kind"]; label: string }[] = [
  { kind: "all", label: "All pixels" }, { kind: "pixel", label: "Pixel" },
  { kind: "row", label: "Row" }, { kind: "column", label: "Column" },
  { kind: "epipolar", label: "Epipolar line of the camera pixel" }, { kind: "drawn", label: "Drawing" },
];

/** Returns the width and height of the projector in pixels, or null without a projector. */
export function projectorSize(itsStore: Store, itsSlice: Slice): [number, number] | null {
  const size = itsStore.attributes.projector?.resolution ?? itsSlice.attributes.projector_size;
  return Array.isArray(size) && size.length === 2 ? [Number(size[0]), Number(size[1])] : null;
}

/** Returns a drawing with everything on, with blocks that are nearly square. */
function blank([width, height]: [number, number]): Drawn {
  const longer = Math.max(width, height);
  const [columns, rows] = [width, height].map((n) => Math.max(1, Math.min(n, Math.round((BLOCKS * n) / longer))));
  return { kind: "drawn", width: columns, height: rows, digits: "9".repeat(columns * rows) };
}

/** Returns the number of rows and columns in an entry of a slice, such as `256 x 1`, or null if each entry is one projector pixel. */
function binned(itsSlice: Slice): string | null {
  const bin = itsSlice.attributes.projector_bin;
  if (!Array.isArray(bin) || (bin[0] === 1 && bin[1] === 1)) return null;
  return `${bin[1]} × ${bin[0]}`;
}

export function ProjectorPanel() {
  const view = state.value;
  const [itsStore, itsSlice] = [store.value, slice.value];
  const { illumination, pixel } = view;
  const [open, setOpen] = useState(true);
  const coordinate = (kind: "y" | "x", index: number) => {
    const axis = itsSlice && axisOf(itsSlice, kind);
    return axis ? axis.coords[Math.min(index, axis.coords.length - 1)] : 0;
  };
  const epipolar = (): Illumination => ({ kind: "epipolar", y: coordinate("y", pixel?.[0] ?? 0), x: coordinate("x", pixel?.[1] ?? 0) });
  // The epipolar line follows the chosen pixel, but not at the start: the URL may hold another one.
  const first = useRef(true);
  useEffect(() => {
    if (!first.current && pixel && illumination.kind === "epipolar") update({ illumination: epipolar() });
    first.current = false;
  }, [pixel?.[0], pixel?.[1]]);

  if (!itsStore || !itsSlice) return null;
  const size = projectorSize(itsStore, itsSlice);
  if (!resolvesProjector(itsSlice) || !size) return <Unresolved store={itsStore} slice={itsSlice} open={open} onToggle={setOpen} />;
  const [width, height] = size;
  const choose = (kind: Illumination["kind"]) => {
    const centre = { v: Math.floor(height / 2), u: Math.floor(width / 2) };
    const now = { ...centre, ...(illumination as { v?: number; u?: number }) };
    const next: Record<Illumination["kind"], () => Illumination> = {
      all: () => ({ kind: "all" }),
      pixel: () => ({ kind: "pixel", v: now.v, u: now.u }),
      row: () => ({ kind: "row", v: now.v }),
      column: () => ({ kind: "column", u: now.u }),
      epipolar,
      drawn: () => blank(size),
    };
    update({ illumination: next[kind]() });
  };
  const { camera, projector } = itsStore.attributes;
  const canBeEpipolar = pixel !== null && isPinhole(camera) && isPinhole(projector);
  return (
    <Panel name="projector-panel" title="Projector" open={open} onToggle={setOpen}>
      <div class="choices" role="radiogroup" aria-label="Illumination">
        {KINDS.map(({ kind, label }) => (
          <label key={kind} class="field switch">
            <input
              type="radio" name="illumination" value={kind} checked={illumination.kind === kind}
              disabled={kind === "epipolar" && !canBeEpipolar} onChange={() => choose(kind)}
            />
            <span>{label}</span>
          </label>
        ))}
      </div>
      {!pixel && <p class="note">Choose a camera pixel to use its epipolar line.</p>}
      {illumination.kind !== "all" && binned(itsSlice) && (
        <p class="note">
          {`An entry of this slice is the light of ${binned(itsSlice)} projector pixels. An illumination of some of them is taken as the same ` +
            "mean drive of all of them."}
        </p>
      )}
      <div class="row">
        {"v" in illumination && (
          <NumberField
            label="Row v" unit="px" value={illumination.v} min={0} max={height - 1}
            onChange={(v) => update({ illumination: { ...illumination, v: Math.round(v) } })}
          />
        )}
        {"u" in illumination && (
          <NumberField
            label="Column u" unit="px" value={illumination.u} min={0} max={width - 1}
            onChange={(u) => update({ illumination: { ...illumination, u: Math.round(u) } })}
          />
        )}
      </div>
      {illumination.kind === "drawn"
        ? <Drawing drawn={illumination} aspect={height / width} empty={blank(size)} />
        : <Preview store={itsStore} illumination={illumination} size={size} />}
    </Panel>
  );
}

/** Names the slices whose projector pixels are resolved. */
function Unresolved({ store: itsStore, slice: itsSlice, open, onToggle }: {
  store: Store;
  slice: Slice;
  open: boolean;
  onToggle: (open: boolean) => void;
}) {
  const others = itsStore.slices.filter(resolvesProjector);
  return (
    <Panel name="projector-panel" title="Projector" open={open} onToggle={onToggle}>
      <p class="note">
        {`The light of the projector pixels is summed in the slice "${itsSlice.name}", so an illumination cannot change it. `}
        {others.length === 0
          ? "No slice of this store resolves projector pixels; render one with `projector = \"all\"` or `{ binned = [16, 16] }`."
          : "These slices resolve projector pixels:"}
      </p>
      <SliceButtons from={itsSlice} slices={others} />
    </Panel>
  );
}

/** The pattern on the projector's plane. A click chooses the pixel, row or column there. */
function Preview({ store: itsStore, illumination, size: [width, height] }: {
  store: Store;
  illumination: Illumination;
  size: [number, number];
}) {
  const { values, error } = useMemo(() => {
    try {
      const pattern = illuminationPattern(illumination, itsStore);
      return { values: pattern?.values ?? new Float32Array(width * height).fill(1), error: null };
    } catch (problem) {
      return { values: new Float32Array(width * height), error: problem instanceof Error ? problem.message : String(problem) };
    }
  }, [JSON.stringify(illumination), itsStore.id, width, height]);
  const pick = (v: number, u: number) => {
    if (illumination.kind === "row") update({ illumination: { kind: "row", v } });
    else if (illumination.kind === "column") update({ illumination: { kind: "column", u } });
    else update({ illumination: { kind: "pixel", v, u } });
  };
  const marker = { row: "v" in illumination ? illumination.v : null, column: "u" in illumination ? illumination.u : null };
  return (
    <>
      {error && <p class="error" role="alert">{error}</p>}
      <MapCanvas
        values={values} height={height} width={width} label="Drive" unit="1" kind="grey" range={[0, 1]} rows="v" columns="u"
        where={(v, u) => `v ${v} px, u ${u} px`} marker={marker} tall={240} onPick={pick}
      />
    </>
  );
}

/** A grid of blocks that the user paints with the pointer, or with arrow keys and the space bar. */
function Drawing({ drawn, aspect, empty }: { drawn: Drawn; aspect: number; empty: Drawn }) {
  const { width, height, digits } = drawn;
  const [brush, setBrush] = useState(9);
  const [cursor, setCursor] = useState<[number, number]>([0, 0]);
  const frame = useRef<HTMLDivElement>(null);
  /** Drive that the current stroke sets. Null: no stroke. */
  const stroke = useRef<string | null>(null);
  const set = (row: number, column: number, digit: string) => {
    const now = state.peek().illumination;
    const at = row * width + column;
    if (now.kind !== "drawn" || now.digits[at] === digit) return;
    update({ illumination: { ...now, digits: now.digits.slice(0, at) + digit + now.digits.slice(at + 1) } });
  };
  const blockAt = (event: PointerEvent): [number, number] => {
    const box = frame.current!.getBoundingClientRect();
    const inside = (value: number, length: number) => Math.max(0, Math.min(length - 1, Math.floor(value * length)));
    return [inside((event.clientY - box.top) / box.height, height), inside((event.clientX - box.left) / box.width, width)];
  };
  /** A stroke that begins on a block with the drive of the brush erases. */
  const digitFor = (row: number, column: number) => (digits[row * width + column] === String(brush) ? "0" : String(brush));
  const paint = (event: PointerEvent) => {
    if (stroke.current === null) return;
    // A fast stroke has several positions in one event.
    const positions = event.getCoalescedEvents?.() ?? [];
    for (const position of positions.length > 0 ? positions : [event]) set(...blockAt(position), stroke.current);
  };
  const onDown = (event: PointerEvent) => {
    const at = blockAt(event);
    setCursor(at);
    stroke.current = digitFor(...at);
    frame.current!.setPointerCapture(event.pointerId);
    paint(event);
  };
  const onKey = (event: KeyboardEvent) => {
    const [row, column] = cursor;
    const moves: Record<string, [number, number]> = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] };
    const by = moves[event.key];
    if (by) setCursor([Math.max(0, Math.min(height - 1, row + by[0])), Math.max(0, Math.min(width - 1, column + by[1]))]);
    else if (event.key === " " || event.key === "Enter") set(row, column, digitFor(row, column));
    else if (/^[0-9]$/.test(event.key)) set(row, column, event.key);
    else return;
    event.preventDefault();
    event.stopPropagation();
  };
  const values = useMemo(() => Float32Array.from(digits, (digit) => Number(digit) / 9), [digits]);
  const fill = (next: string) => update({ illumination: { ...drawn, digits: next } });
  const drive = values[cursor[0] * width + cursor[1]];
  const lit = digits.replaceAll("0", "").length;
  const cursorText = `Row ${cursor[0]}, column ${cursor[1]}: drive ${drive.toFixed(2)}`;
  return (
    <>
      <Slider label="Brush" value={brush} min={1} max={9} text={`drive ${(brush / 9).toFixed(2)}`} onChange={setBrush} />
      <div
        ref={frame} class="drawing" tabIndex={0} role="application"
        aria-label={`Drawing, ${height} rows and ${width} columns of blocks, ${lit} on. ${cursorText}`}
        aria-roledescription="drawing; arrow keys move, the space bar paints, digits set the drive"
        style={{ aspectRatio: `1 / ${aspect}`, maxWidth: `${340 / aspect}px`, gridTemplateColumns: `repeat(${width}, 1fr)` }}
        onPointerDown={onDown} onPointerMove={paint} onKeyDown={onKey}
        onPointerUp={() => (stroke.current = null)} onPointerCancel={() => (stroke.current = null)}
      >
        {Array.from(values, (value, i) => {
          const isCursor = i === cursor[0] * width + cursor[1];
          const level = Math.round(255 * Math.sqrt(value));
          return <span key={i} class={isCursor ? "block cursor" : "block"} style={{ background: `rgb(${level} ${level} ${level})` }} />;
        })}
      </div>
      <div class="row">
        <button type="button" onClick={() => update({ illumination: empty })}>All off</button>
        <button type="button" onClick={() => fill("9".repeat(digits.length))}>All on</button>
        <button type="button" onClick={() => fill(Array.from(digits, (digit) => 9 - Number(digit)).join(""))}>Invert</button>
      </div>
    </>
  );
}
