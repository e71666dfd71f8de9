/** The dialog that takes out what the view shows: images, numbers, and commands that give the same numbers. */

import { useEffect, useRef, useState } from "preact/hooks";
import { description, slice, source, store } from "../data";
import { labelledCsv } from "../display/csv";
import { canvasPng, download, pictureCanvas, pictureSvg } from "../display/export";
import { pictureCsv } from "../display/picture";
import { greyPng } from "../display/png";
import { shown } from "../display/shown";
import { axisOf, isPolarized, type Slice, type Store } from "../model";
import { command, figureCommand, illuminationPattern, PATTERN_FILE, python, queryProbe, type Query } from "../request";
import type { ProbeRequest } from "../sources/source";
import { SourceError } from "../sources/source";
import { state, toHash } from "../state";
import { legendTitle } from "./ColourBar";
import { Dialog } from "./Dialog";
import { Choice, Switch } from "./Field";

const QUERY_LABELS: Record<Query, string> = {
  matrix: "Matrix of the chosen pixel",
  profile: "Time profile of the chosen pixel",
  stokes: "Stokes vector of the chosen pixel for the input state",
  image: "Mueller image",
};

/** A text with a button that copies it. */
function Copy({ label, text }: { label: string; text: string }) {
  const [isCopied, setCopied] = useState(false);
  const shownText = useRef<HTMLPreElement>(null);
  useEffect(() => setCopied(false), [text]);
  const copy = async (): Promise<void> => {
    try {
      await navigator.clipboard.writeText(text);
      setCopied(true);
    } catch {
      // Browsers refuse the clipboard to pages that are not on this machine or on HTTPS: the user copies the selection.
      getSelection()?.selectAllChildren(shownText.current!);
    }
  };
  return (
    <div class="copy">
      <span class="copy-label">{label}</span>
      <pre ref={shownText} tabIndex={0} aria-label={label}>{text}</pre>
      <button type="button" aria-label={`Copy: ${label}`} onClick={() => void copy()}>{isCopied ? "Copied" : "Copy"}</button>
    </div>
  );
}

/** Returns a query's request, or the reason why there is none. */
function requestOf(query: Query, itsStore: Store, itsSlice: Slice): ProbeRequest | string {
  try {
    return queryProbe(query, state.value, itsStore, itsSlice);
  } catch (error) {
    if (error instanceof SourceError) return error.message;
    throw error;
  }
}

function Numbers({ itsStore, itsSlice }: { itsStore: Store; itsSlice: Slice }) {
  const view = state.value;
  const hasTime = axisOf(itsSlice, "t") !== undefined;
  const queries = (Object.keys(QUERY_LABELS) as Query[]).filter((query) =>
    query === "image" || (view.pixel !== null && (query !== "profile" || hasTime) && (query !== "stokes" || isPolarized(itsSlice))));
  const [query, setQuery] = useState<Query>(queries[0]);
  const [error, setError] = useState<string | null>(null);
  const request = requestOf(query, itsStore, itsSlice);
  const output = query === "image" ? `${itsSlice.name}.npy` : null;
  const csv = async (): Promise<void> => {
    try {
      if (typeof request === "string" || !source.value) return;
      download(`${itsSlice.name}_${query}.csv`, labelledCsv(await source.value.probe(request)), "text/csv");
      setError(null);
    } catch (failed) {
      setError(failed instanceof SourceError ? failed.message : String(failed));
    }
  };
  const pattern = async (): Promise<void> => {
    const drive = illuminationPattern(view.illumination, itsStore);
    if (drive) download(PATTERN_FILE, await greyPng(drive.values, drive.width, drive.height), "image/png");
  };
  return (
    <section aria-label="Numbers and commands">
      <h3>Numbers</h3>
      <Choice label="Query" value={query} options={queries.map((value) => ({ value, label: QUERY_LABELS[value] }))} onChange={setQuery} />
      {view.pixel === null && <p>Choose a pixel to take out its numbers.</p>}
      {typeof request === "string" ? <p role="alert" class="error">{request}</p> : (
        <>
          <Copy label="Command" text={command(request, itsStore, output)} />
          <Copy label="Python" text={python(request, itsStore)} />
          <p class="dialog-actions">
            {request.pattern && <button type="button" onClick={() => void pattern()}>Download {PATTERN_FILE}</button>}
            {query !== "image" && <button type="button" onClick={() => void csv()}>Download CSV of the query</button>}
          </p>
          {view.analyzer && <p>The numbers are without the analyzer A. The image shows A · S / 2 of the Stokes vectors S.</p>}
          {request.pattern && <p>The command and Python read the illumination from {PATTERN_FILE} in the current folder.</p>}
        </>
      )}
      {error && <p role="alert" class="error">{error}</p>}
    </section>
  );
}

export function Out({ onClose }: { onClose: () => void }) {
  const [withBar, setBar] = useState(true);
  const [itsStore, itsSlice, s] = [store.value, slice.value, shown.value];
  if (!itsStore || !itsSlice) return null;
  const picture = s?.main ?? null;
  const title = picture ? `${itsSlice.name}: ${picture.legend ? legendTitle(picture.legend) : picture.title}` : "";
  const name = `${itsSlice.name}_${state.value.quantity}`;
  const drawn = picture && figureCommand(state.value, itsStore, itsSlice, picture.white ?? 0);
  const png = async (): Promise<void> => {
    if (picture) download(`${name}.png`, await canvasPng(pictureCanvas(picture, withBar ? title : null)), "image/png");
  };
  const link = `${location.origin}${location.pathname}${location.search}#${toHash(state.value)}`;
  return (
    <Dialog title="Take out" onClose={onClose}>
      {picture && s && (
        <section aria-label="Image files">
          <h3>Image</h3>
          <Switch label="Colour bar in the PNG file" checked={withBar} disabled={!picture.legend} onChange={setBar} />
          <p class="dialog-actions">
            <button type="button" onClick={() => void png()}>Download PNG</button>
            <button type="button" onClick={() => download(`${name}.svg`, pictureSvg(picture, title), "image/svg+xml")}>Download SVG</button>
            <button type="button" onClick={() => download(`${name}.csv`, pictureCsv(s.image, picture), "text/csv")}>
              Download CSV of the image
            </button>
          </p>
          {drawn && <Copy label="Command that draws the image" text={drawn} />}
        </section>
      )}
      <Numbers itsStore={itsStore} itsSlice={itsSlice} />
      <section aria-label="Link">
        <h3>Link</h3>
        <Copy label="Address of this view" text={link} />
        {!description.value?.isStatic && (
          <p>The address works while this server runs. It contains the access token of the server: do not publish it.</p>
        )}
      </section>
    </Dialog>
  );
}
