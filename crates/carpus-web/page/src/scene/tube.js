// A muscle: a tube along its path, which is drawn anew in every posture.
import { BufferAttribute, BufferGeometry, Mesh, MeshStandardMaterial, Vector3 } from "three";

/** Corners of a tube's section. */
const SIDES = 10;

const [tangent, before, axis, normal, binormal] = Array.from({ length: 5 }, () => new Vector3());

export class Tube {
  constructor(radius) {
    this.radius = radius;
    this.material = new MeshStandardMaterial({ roughness: 0.55, metalness: 0 });
    this.mesh = new Mesh(new BufferGeometry(), this.material);
    this.mesh.frustumCulled = false;
    this.rings = 0;
  }

  reserve(rings) {
    if (rings <= this.rings) return;
    this.rings = rings;
    const { geometry } = this.mesh;
    for (const name of ["position", "normal"]) {
      geometry.setAttribute(name, new BufferAttribute(new Float32Array(3 * SIDES * rings), 3));
    }
    const index = [];
    for (let r = 0; r + 1 < rings; r += 1)
      for (let s = 0; s < SIDES; s += 1) {
        const [a, b] = [r * SIDES + s, r * SIDES + ((s + 1) % SIDES)];
        index.push(a, b, a + SIDES, b, b + SIDES, a + SIDES);
      }
    geometry.setIndex(index);
  }

  /** - `points`: x, y, z of one after the other; `scale`: of the radius */
  draw(points, scale = 1) {
    const count = points.length / 3;
    this.points = points;
    this.reserve(count);
    const { geometry } = this.mesh;
    const [position, normals] = [geometry.attributes.position, geometry.attributes.normal];
    const at = (i, out) => out.set(points[3 * i], points[3 * i + 1], points[3 * i + 2]);
    const [p, q, r] = [new Vector3(), new Vector3(), new Vector3()];
    for (let i = 0; i < count; i += 1) {
      at(i, p);
      at(Math.max(i - 1, 0), q);
      at(Math.min(i + 1, count - 1), r);
      before.subVectors(p, q).normalize();
      tangent.subVectors(r, p).normalize();
      // Half way round the corner.
      tangent.add(before);
      if (tangent.lengthSq() < 1e-12) tangent.set(0, 1, 0);
      tangent.normalize();
      if (i === 0) {
        axis.set(Math.abs(tangent.x) < 0.7 ? 1 : 0, Math.abs(tangent.x) < 0.7 ? 0 : 1, 0);
        normal.crossVectors(tangent, axis).normalize();
      } else {
        normal.addScaledVector(tangent, -normal.dot(tangent));
        if (normal.lengthSq() < 1e-12) normal.crossVectors(tangent, axis);
        normal.normalize();
      }
      binormal.crossVectors(tangent, normal);
      const radius = this.radius * scale;
      for (let s = 0; s < SIDES; s += 1) {
        const [sine, cosine] = [Math.sin((s / SIDES) * 2 * Math.PI), Math.cos((s / SIDES) * 2 * Math.PI)];
        const [x, y, z] = [
          normal.x * cosine + binormal.x * sine,
          normal.y * cosine + binormal.y * sine,
          normal.z * cosine + binormal.z * sine,
        ];
        position.setXYZ(i * SIDES + s, p.x + radius * x, p.y + radius * y, p.z + radius * z);
        normals.setXYZ(i * SIDES + s, x, y, z);
      }
    }
    position.needsUpdate = normals.needsUpdate = true;
    geometry.setDrawRange(0, 6 * SIDES * Math.max(count - 1, 0));
  }
}
