// Parts of the page that need no MuJoCo and no network: what each question of a file is answered.
import { given, made } from "./given.mjs";

const { chamferDistance } = made("aim");

const answers = {
  // The distance, and how long it took [s].
  chamfer({ a, b, size }) {
    const [one, other] = [a, b].map((mask) => Uint8Array.from(mask));
    const start = performance.now();
    return { distance: chamferDistance(one, other, size), seconds: (performance.now() - start) / 1000 };
  },
};
console.log(JSON.stringify(given.map(({ what, ...more }) => answers[what](more))));
