// A posture as the program gives it: numbers one after the other.

/** - `flat`: coordinates; twelve numbers of every body; length, count and points of every muscle */
export function decoded(flat, { coordinates, bodies, muscles }) {
  let at = 0;
  const next = (count) => flat.subarray(at, (at += count));
  const q = next(coordinates.length);
  const poses = bodies.map(() => next(12));
  const paths = muscles.map(() => {
    const [length, count] = next(2);
    return { length, points: next(3 * count) };
  });
  return { q, poses, paths };
}
