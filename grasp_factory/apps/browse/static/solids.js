// The gripper as three boxes and the arm as lines, in the world.

import { cssColor } from './format.js';
import * as THREE from './vendor/three.js';

const PALM = 0.1; // metres from the TCP back to the palm
const THICK = 0.01;
const GRIPPER = cssColor('--gripper');
const ARM = cssColor('--arm');

/** Put an object at a pose: x, y, z, quaternion x, y, z, w. */
export function place(object, [x, y, z, qx, qy, qz, qw]) {
  object.position.set(x, y, z);
  object.quaternion.set(qx, qy, qz, qw);
}

/** padSize: width along x and height along z, metres. */
export function makeGripper(padSize) {
  const [width, height] = padSize ?? [0.02, 0.04];
  const material = new THREE.MeshLambertMaterial({ color: GRIPPER });
  const pad = new THREE.BoxGeometry(width, THICK, height);
  const palm = new THREE.BoxGeometry(width * 1.5, 0.12, 0.025);
  const pads = [1, -1].map((side) => ({ side, mesh: new THREE.Mesh(pad, material) }));
  const back = new THREE.Mesh(palm, material);
  back.position.z = -PALM;
  const group = new THREE.Group();
  group.add(back, ...pads.map(({ mesh }) => mesh));
  return {
    group,
    move(pose, opening) {
      place(group, pose);
      for (const { side, mesh } of pads) mesh.position.y = side * ((opening ?? 0) / 2 + THICK / 2);
    },
    dispose() {
      [pad, palm, material].forEach((part) => part.dispose());
    },
  };
}

/** positions: [record][link][3]; null where the server knows no links. */
export function makeSkeleton(positions) {
  const links = positions?.[0]?.length ?? 0;
  if (links < 2) return null;
  const place = new THREE.BufferAttribute(new Float32Array(3 * links), 3);
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', place);
  const material = new THREE.LineBasicMaterial({ color: ARM });
  const line = new THREE.Line(geometry, material);
  const ball = new THREE.SphereGeometry(0.015, 12, 8);
  const paint = new THREE.MeshLambertMaterial({ color: ARM });
  const joints = Array.from({ length: links }, () => new THREE.Mesh(ball, paint));
  const group = new THREE.Group();
  group.add(line, ...joints);
  line.frustumCulled = false; // its bounds are those of the first record
  return {
    group,
    move(record) {
      const points = positions[record];
      group.visible = Boolean(points);
      if (!points) return;
      points.forEach((point, i) => {
        place.setXYZ(i, ...point);
        joints[i].position.set(...point);
      });
      place.needsUpdate = true;
    },
    dispose() {
      [geometry, material, ball, paint].forEach((part) => part.dispose());
    },
  };
}
