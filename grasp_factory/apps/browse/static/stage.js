// The place where 3-D things are shown: what draws them, and the eye that can be turned about them.

import { h } from './dom.js';
import { cssColor } from './format.js';
import * as THREE from './vendor/three.js';

const TABLE = [0.55, 0]; // the middle of where the arm works, metres
const TOWARDS_EYE = new THREE.Vector3(0.95, -0.8, 0.55).normalize();
const MARGIN = 1.08; // of the distance at which all points are just seen
const NEAREST = 0.5; // metres
const FAR = 2; // metres, where there is nothing to fit

/** Renderer, camera, lights and table grid, drawn only when something has changed; null without WebGL. */
export function makeStage(host) {
  const canvas = h('canvas', { class: 'space-canvas', tabindex: 0, role: 'img', 'aria-label': 'Points of the scene in 3-D: drag to turn', dataset: { testid: 'cloud' } });
  // Kept after drawing, so that it can be read back as a picture.
  const kept = { alpha: true, antialias: true, preserveDrawingBuffer: true };
  const context = canvas.getContext('webgl2', kept);
  if (!context) return null;
  const renderer = new THREE.WebGLRenderer({ canvas, context, ...kept });
  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(40, 4 / 3, 0.02, 20);
  camera.up.set(0, 0, 1);
  const controls = new THREE.OrbitControls(camera, canvas);
  const light = new THREE.DirectionalLight(0xffffff, 1.6);
  light.position.set(1, -1, 2);
  scene.add(new THREE.AmbientLight(0xffffff, 1.4), light);
  let isOver = false;
  let isPlaced = false;
  let asked = 0;
  let subject = [];
  let grid = null;
  const scheme = matchMedia('(prefers-color-scheme: dark)');
  scheme.addEventListener('change', drawGrid);
  drawGrid();

  function draw() {
    if (!asked && !isOver) asked = requestAnimationFrame(render);
  }

  function drawGrid() {
    if (grid) scene.remove(grid);
    grid?.dispose();
    grid = new THREE.GridHelper(1.2, 24, cssColor('--line-strong'), cssColor('--line'));
    grid.rotation.x = Math.PI / 2;
    grid.position.set(...TABLE, -0.001);
    scene.add(grid);
    draw();
  }

  function render() {
    asked = 0;
    renderer.render(scene, camera);
  }

  function frame() {
    const { center, distance } = framed(subject, camera);
    controls.target.copy(center);
    camera.position.copy(center).addScaledVector(TOWARDS_EYE, distance);
    controls.update();
    draw();
  }

  const sized = new ResizeObserver(() => {
    const { clientWidth: width, clientHeight: height } = host;
    if (!width || !height) return;
    renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    if (!isPlaced) frame();
    isPlaced = true;
    draw();
  });
  sized.observe(host);
  controls.addEventListener('change', draw);
  host.append(canvas);

  return {
    scene,
    draw,
    isOver: () => isOver,
    /** Looks from ahead of the arm so that all these points, [x, y, z], are seen. */
    show(points) {
      subject = points;
      frame();
    },
    reset: frame,
    stop() {
      isOver = true;
      cancelAnimationFrame(asked);
      sized.disconnect();
      scheme.removeEventListener('change', drawGrid);
      controls.dispose();
      grid.dispose();
      renderer.dispose();
      renderer.forceContextLoss();
    },
  };
}

/** Where to look and from how far, for a camera to see all points from that side. */
function framed(points, camera) {
  if (!points.length) return { center: new THREE.Vector3(...TABLE, 0), distance: FAR };
  const middle = (axis) => {
    const values = points.map((point) => point[axis]);
    return values.reduce((a, b) => Math.min(a, b)) / 2 + values.reduce((a, b) => Math.max(a, b)) / 2;
  };
  const center = new THREE.Vector3(middle(0), middle(1), middle(2));
  const right = new THREE.Vector3().crossVectors(camera.up, TOWARDS_EYE).normalize();
  const up = new THREE.Vector3().crossVectors(TOWARDS_EYE, right);
  const slope = Math.tan(((camera.fov / 2) * Math.PI) / 180);
  const needed = points.map((point) => {
    const from = new THREE.Vector3(...point).sub(center);
    const aside = Math.abs(from.dot(right)) / camera.aspect;
    return Math.max(aside, Math.abs(from.dot(up))) / slope + from.dot(TOWARDS_EYE);
  });
  return { center, distance: MARGIN * needed.reduce((a, b) => Math.max(a, b), NEAREST) };
}
