// Colours that people with any kind of colour vision can distinguish (Okabe and Ito 2008), legible on light and on dark.

export const PALETTE = ["#0080c8", "#d98200", "#009e73", "#c8679b", "#d55e00", "#4bb0e8", "#8f8a2a", "#7a63c8"];

/** A muscle of which nothing is said by its colour. */
export const MUSCLE = "#a8544a";

export const cycled = (i) => PALETTE[i % PALETTE.length];

/** From nothing to all: pale to deep, lighter to darker throughout. */
const SCALE = [
  [0, [150, 180, 214]],
  [0.25, [246, 190, 110]],
  [0.6, [221, 94, 28]],
  [1, [120, 14, 20]],
];

/** The colour of a part from 0 to 1. */
export function heat(part) {
  const at = Math.min(Math.max(Number.isFinite(part) ? part : 0, 0), 1);
  const above = Math.max(
    SCALE.findIndex(([end]) => end >= at),
    1,
  );
  const [[low, from], [high, to]] = [SCALE[above - 1], SCALE[above]];
  const mixed = from.map((v, k) => Math.round(v + ((at - low) / (high - low)) * (to[k] - v)));
  return `rgb(${mixed.join(",")})`;
}
