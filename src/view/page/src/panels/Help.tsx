/** The keys, and the way back to the tour. */

import { description } from "../data";
import { Dialog } from "./Dialog";

const KEYS: readonly [string, string][] = [
  ["?", "Show this help"],
  ["Arrow keys, drag", "Move the image"],
  ["+ and −, wheel, pinch, double click", "Zoom"],
  ["0", "Show the whole image"],
  ["Click, Shift + arrow keys", "Choose a pixel, move the chosen pixel by one"],
  ["Space", "Play or pause the time bins"],
  [", and .", "Show the previous or the next time bin"],
  ["[ and ]", "Change the exposure by half a stop"],
  ["P, M, G", "Show the photograph, a Mueller element, or the 4 × 4 grid"],
  ["O", "Take out: image, numbers, commands"],
  ["Tab, arrow keys", "Go to a control, change it"],
  ["Escape", "Close a dialog or the tour"],
];

export function Help({ onClose, onTour }: { onClose: () => void; onTour: () => void }) {
  return (
    <Dialog title="Help" onClose={onClose}>
      <p>
        Letters and signs work unless a text field or a list has the focus. The keys that move the image work when the image has the
        focus.
      </p>
      <table class="keys">
        <thead><tr><th scope="col">Key or gesture</th><th scope="col">Action</th></tr></thead>
        <tbody>{KEYS.map(([name, action]) => <tr key={name}><th scope="row">{name}</th><td>{action}</td></tr>)}</tbody>
      </table>
      <p>The address of this page contains the view. Send the address to show the same view of the same stores.</p>
      <p class="dialog-actions">
        <button type="button" onClick={onTour}>Start the tour</button>
        <span>Sunstone {description.value?.version}</span>
      </p>
    </Dialog>
  );
}
