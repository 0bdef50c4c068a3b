// Bones and wrapping surfaces.
import {
  BufferAttribute,
  BufferGeometry,
  Color,
  CylinderGeometry,
  DoubleSide,
  Group,
  LatheGeometry,
  Matrix4,
  Mesh,
  MeshStandardMaterial,
  Quaternion,
  SphereGeometry,
  TorusGeometry,
  Vector2,
  Vector3,
} from "three";

const BONE = "#d9d2c2";
const SURFACE = "#3f8fd0";

/** A matrix from a pose: rotation by rows, position. */
export function matrix(pose) {
  const [a, b, c, d, e, f, g, h, i, x, y, z] = pose;
  return new Matrix4().set(a, b, c, x, d, e, f, y, g, h, i, z, 0, 0, 0, 1);
}

const material = (color, more = {}) =>
  new MeshStandardMaterial({ color: new Color(color), roughness: 0.85, metalness: 0, ...more });

/** The outline of a long bone of length 1 and radius 1: wide at its ends. */
const OUTLINE = [
  [0, 0],
  [0.75, 0.015],
  [1, 0.06],
  [0.82, 0.14],
  [0.5, 0.3],
  [0.46, 0.6],
  [0.62, 0.85],
  [0.82, 0.94],
  [0.6, 0.985],
  [0, 1],
].map(([r, y]) => new Vector2(r, y));

/** A plain bone from one point of its body to another. */
export function plainBone({ from, to }) {
  const [a, b] = [new Vector3(...from), new Vector3(...to)];
  const length = a.distanceTo(b);
  const radius = Math.min(Math.max(0.075 * length, 0.0025), 0.02);
  const bone = new Mesh(new LatheGeometry(OUTLINE, 20), material(BONE));
  bone.scale.set(radius, length, radius);
  bone.position.copy(a);
  bone.quaternion.copy(new Quaternion().setFromUnitVectors(new Vector3(0, 1, 0), b.sub(a).normalize()));
  return bone;
}

/** Bone geometry of the page: { shown, geometries }; null where it has none. */
export function meshes(bytes) {
  if (!bytes.length) return null;
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const length = view.getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length)));
  let at = 4 + length;
  const take = (count) => bytes.slice(at, (at += count)).buffer;
  const geometries = header.meshes.map(({ points, triangles, low, step }) => {
    const whole = new Uint16Array(take(6 * points));
    const positions = Float32Array.from(whole, (v, i) => low[i % 3] + step[i % 3] * v);
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(positions, 3));
    geometry.setIndex(new BufferAttribute(new Uint32Array(take(12 * triangles)), 1));
    geometry.computeVertexNormals();
    return geometry;
  });
  return { shown: header.shown, geometries };
}

export function mesh({ mesh: index, pose, scale, color, opacity }, { geometries }) {
  // White is OpenSim's default, and no colour of bone.
  const isWhite = color.every((v) => v > 0.98);
  const looks = material(isWhite ? BONE : new Color(...color), {
    side: DoubleSide,
    ...(opacity < 1 ? { transparent: true, opacity } : {}),
  });
  const made = new Mesh(geometries[index], looks);
  made.matrixAutoUpdate = false;
  made.matrix.copy(matrix(pose)).scale(new Vector3(...scale));
  return made;
}

/** A wrapping surface in the frame of its body. */
export function surface({ pose, shape }) {
  const looks = material(SURFACE, { transparent: true, opacity: 0.22, depthWrite: false, side: DoubleSide });
  const turned = (geometry) => geometry.rotateX(Math.PI / 2);
  const geometry = {
    ellipsoid: () => new SphereGeometry(1, 32, 20).scale(...shape.radii),
    // Along z, as OpenSim has it.
    cylinder: () => turned(new CylinderGeometry(shape.radius, shape.radius, shape.length, 36, 1, true)),
    torus: () => new TorusGeometry(shape.radius, shape.tube, 16, 48),
  }[shape.kind]();
  const made = new Mesh(geometry, looks);
  made.matrixAutoUpdate = false;
  made.matrix.copy(matrix(pose));
  return made;
}

/** A group for every body, which its pose moves. */
export function bodies(count) {
  return Array.from({ length: count }, () => {
    const group = new Group();
    group.matrixAutoUpdate = false;
    return group;
  });
}
