/** Gestures on the image: drag, pinch, wheel, click and double click, with mouse, pen or touch. */

/** What a gesture does. Positions are in CSS pixels from the upper left corner of the element. */
export interface Gestures {
  drag(down: number, right: number, top: number, left: number): void;
  zoom(factor: number, top: number, left: number): void;
  click(top: number, left: number): void;
  doubleClick(top: number, left: number): void;
  move(top: number, left: number): void;
  leave(): void;
}

/** Pixels that a pointer can move in a click. */
const CLICK_PX = 4;

/** Listens to an element. Returns a function that stops listening. */
export function listen(element: HTMLElement, gestures: Gestures): () => void {
  const pointers = new Map<number, { top: number; left: number }>();
  let moved = 0;
  const at = (event: MouseEvent): { top: number; left: number } => {
    const box = element.getBoundingClientRect();
    return { top: event.clientY - box.top, left: event.clientX - box.left };
  };
  const spread = (): { distance: number; top: number; left: number } => {
    const [a, b] = [...pointers.values()];
    return { distance: Math.hypot(a.top - b.top, a.left - b.left), top: (a.top + b.top) / 2, left: (a.left + b.left) / 2 };
  };

  const down = (event: PointerEvent): void => {
    if (event.button !== 0) return;
    element.setPointerCapture(event.pointerId);
    if (pointers.size === 0) moved = 0;
    pointers.set(event.pointerId, at(event));
  };
  const move = (event: PointerEvent): void => {
    const next = at(event);
    const last = pointers.get(event.pointerId);
    gestures.move(next.top, next.left);
    if (!last) return;
    const before = pointers.size === 2 ? spread() : null;
    pointers.set(event.pointerId, next);
    const [dy, dx] = [next.top - last.top, next.left - last.left];
    moved += Math.abs(dy) + Math.abs(dx);
    if (before) {
      const after = spread();
      gestures.zoom(after.distance / Math.max(1, before.distance), after.top, after.left);
      gestures.drag(after.top - before.top, after.left - before.left, after.top, after.left);
    } else if (pointers.size === 1 && moved > CLICK_PX) {
      gestures.drag(dy, dx, next.top, next.left);
    }
  };
  const up = (event: PointerEvent): void => {
    if (!pointers.delete(event.pointerId)) return;
    const { top, left } = at(event);
    if (event.type === "pointerup" && pointers.size === 0 && moved <= CLICK_PX) gestures.click(top, left);
  };
  const leave = (): void => gestures.leave();
  const wheel = (event: WheelEvent): void => {
    event.preventDefault();
    const { top, left } = at(event);
    // A wheel reports lines or pixels; a pinch on a touchpad is a wheel with Ctrl.
    const pixels = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 * event.deltaY : event.deltaY;
    gestures.zoom(Math.exp(-pixels * (event.ctrlKey ? 0.01 : 0.0015)), top, left);
  };
  const double = (event: MouseEvent): void => {
    const { top, left } = at(event);
    gestures.doubleClick(top, left);
  };

  element.addEventListener("pointerdown", down);
  element.addEventListener("pointermove", move);
  element.addEventListener("pointerup", up);
  element.addEventListener("pointercancel", up);
  element.addEventListener("pointerleave", leave);
  element.addEventListener("wheel", wheel, { passive: false });
  element.addEventListener("dblclick", double);
  return () => {
    element.removeEventListener("pointerdown", down);
    element.removeEventListener("pointermove", move);
    element.removeEventListener("pointerup", up);
    element.removeEventListener("pointercancel", up);
    element.removeEventListener("pointerleave", leave);
    element.removeEventListener("wheel", wheel);
    element.removeEventListener("dblclick", double);
  };
}
