// Poses in the world and where a camera sees them. A pose is x, y, z, then the quaternion x, y, z, w.

const NEAR = 0.02; // metres in front of the camera from which on something is drawn

/** A point given in a pose's own frame, in the world. */
export function placed(pose, local) {
  const [px, py, pz, x, y, z, w] = pose;
  const [a, b, c] = local;
  // v + 2 w (q x v) + 2 q x (q x v)
  const ux = 2 * (y * c - z * b);
  const uy = 2 * (z * a - x * c);
  const uz = 2 * (x * b - y * a);
  return [
    px + a + w * ux + y * uz - z * uy,
    py + b + w * uy + z * ux - x * uz,
    pz + c + w * uz + x * uy - y * ux,
  ];
}

export function isPose(pose) {
  return Array.isArray(pose) && pose.every(Number.isFinite);
}

/** A camera of /api/episode at frame 0 or 1. */
export function makeView(camera, frame) {
  const T = camera.T_world_camera[frame];
  const [[fx, , cx], [, fy, cy]] = camera.intrinsics;

  function inCamera(point) {
    const d = [point[0] - T[0][3], point[1] - T[1][3], point[2] - T[2][3]];
    return [0, 1, 2].map((i) => T[0][i] * d[0] + T[1][i] * d[1] + T[2][i] * d[2]);
  }

  // Pixel values are samples at integer coordinates: a canvas has their middles at a half.
  function pixel([x, y, z]) {
    return [(fx * x) / z + cx + 0.5, (fy * y) / z + cy + 0.5];
  }

  return {
    /** Where a point of the world is in the image, or null behind the camera. */
    point(world) {
      const at = inCamera(world);
      return at[2] > NEAR ? pixel(at) : null;
    },

    /** Both ends of a line in the image, cut where it passes behind the camera, or null. */
    line(from, to) {
      let [a, b] = [inCamera(from), inCamera(to)];
      if (a[2] <= NEAR && b[2] <= NEAR) return null;
      if (a[2] <= NEAR) a = cut(b, a);
      if (b[2] <= NEAR) b = cut(a, b);
      return [pixel(a), pixel(b)];
    },
  };
}

function cut(front, behind) {
  const share = (front[2] - NEAR) / (front[2] - behind[2]);
  const at = [0, 1, 2].map((i) => front[i] + share * (behind[i] - front[i]));
  at[2] = NEAR * 1.0001;
  return at;
}

/** True where both images of a camera are taken from the same place. */
export function stands(camera) {
  const [a, b] = camera.T_world_camera;
  return a.every((row, i) => row.every((value, j) => Math.abs(value - b[i][j]) < 1e-6));
}
