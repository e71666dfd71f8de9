/** Labelled controls. */

import type { ComponentChildren } from "preact";
import { useState } from "preact/hooks";

interface NumberFieldProps {
  label: string;
  unit?: string;
  value: number;
  min?: number;
  max?: number;
  step?: number | "any";
  disabled?: boolean;
  /** Called with numbers between `min` and `max`. */
  onChange: (value: number) => void;
}

/** A number with its label and unit. While the field has the focus, it shows the text that the user types. */
export function NumberField({ label, unit, value, min = -Infinity, max = Infinity, step = 1, disabled, onChange }: NumberFieldProps) {
  const [text, setText] = useState<string | null>(null);
  const accept = (typed: string) => {
    setText(typed);
    const number = Number(typed);
    if (typed.trim() !== "" && number >= min && number <= max) onChange(number);
  };
  return (
    <label class="field">
      <span>{label}</span>
      <input
        type="number" value={text ?? String(Number(value.toPrecision(7)))} step={step} disabled={disabled}
        min={Number.isFinite(min) ? min : undefined} max={Number.isFinite(max) ? max : undefined}
        onInput={(event) => accept(event.currentTarget.value)} onBlur={() => setText(null)}
      />
      {unit && <span class="unit">{unit}</span>}
    </label>
  );
}

interface SliderProps {
  label: string;
  value: number;
  min: number;
  max: number;
  step?: number;
  disabled?: boolean;
  /** The value with its unit. */
  text: string;
  onChange: (value: number) => void;
}

export function Slider({ label, value, min, max, step = 1, disabled, text, onChange }: SliderProps) {
  return (
    <label class="field slider">
      <span>{label}</span>
      <input
        type="range" value={value} min={min} max={max} step={step} disabled={disabled} aria-valuetext={text}
        onInput={(event) => onChange(Number(event.currentTarget.value))}
      />
      <output>{text}</output>
    </label>
  );
}

interface ChoiceProps<T extends string> {
  label: string;
  value: T;
  options: readonly { value: T; label: string; disabled?: boolean }[];
  onChange: (value: T) => void;
}

/** A drop-down list. */
export function Choice<T extends string>({ label, value, options, onChange }: ChoiceProps<T>) {
  return (
    <label class="field">
      <span>{label}</span>
      <select value={value} onChange={(event) => onChange(event.currentTarget.value as T)}>
        {options.map((option) => (
          <option key={option.value} value={option.value} disabled={option.disabled}>{option.label}</option>
        ))}
      </select>
    </label>
  );
}

interface SwitchProps {
  label: string;
  checked: boolean;
  disabled?: boolean;
  onChange: (checked: boolean) => void;
}

export function Switch({ label, checked, disabled, onChange }: SwitchProps) {
  return (
    <label class="field switch">
      <input type="checkbox" checked={checked} disabled={disabled} onChange={(event) => onChange(event.currentTarget.checked)} />
      <span>{label}</span>
    </label>
  );
}

interface PanelProps {
  /** Class of the panel, and its name in tests. */
  name: string;
  title: string;
  error?: string | null;
  notes?: readonly string[];
  /** New contents have been requested. */
  waiting?: boolean;
  /** Whether the contents are shown. Absent: always. */
  open?: boolean;
  onToggle?: (open: boolean) => void;
  children?: ComponentChildren;
}

/** The frame of a panel: a heading that shows or hides the contents, and an error in place of missing contents. */
export function Panel({ name, title, error, notes = [], waiting, open = true, onToggle, children }: PanelProps) {
  return (
    <section class={`panel ${name}`} aria-label={title} aria-busy={waiting ? "true" : "false"}>
      <h2><Toggle title={title} open={open} onToggle={onToggle} /></h2>
      {open && error && <p class="error" role="alert">{error}</p>}
      {open && children}
      {open && notes.map((note) => <p key={note} class="note">{note}</p>)}
    </section>
  );
}

/** The text of a heading, as a button if its contents can be hidden. */
export function Toggle({ title, open, onToggle }: Pick<PanelProps, "title" | "open" | "onToggle">) {
  if (!onToggle) return <>{title}</>;
  return (
    <button type="button" class="panel-toggle" aria-expanded={open ? "true" : "false"} onClick={() => onToggle(!open)}>
      <span aria-hidden="true">{open ? "▾" : "▸"}</span> {title}
    </button>
  );
}
