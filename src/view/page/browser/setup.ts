/** Renders and captures the stores of the tests once, and serves them. */

import { mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileServer, ROOT, stop, sunstone, view } from "./program";

/** Stores and addresses of a run. */
export interface Bench {
  folder: string;
  /** The mirror room, with all slices. */
  room: string;
  /** A run of a simulated rig. */
  captures: string;
  /** Address of `sunstone view` with both stores. */
  address: string;
  /** Address of the export of the mirror room, on a plain file server. */
  exported: string;
}

const PLAN = (rig: string): string => `name = "browser test"
rig = "${rig}"
scheme = { kind = "drr", captures = 16 }

[camera]
exposures_ms = [25]
format = "Mono12p"
masks = ["dark", "full"]
`;

/** Prepares the run. Returns the function that ends it. */
export default async function setup(): Promise<() => Promise<void>> {
  const folder = mkdtempSync(join(tmpdir(), "sunstone-view-"));
  const [room, captures, exported, plan] = ["room.zarr", "captures.zarr", "export", "plan.toml"].map((name) => join(folder, name));
  sunstone("render", "scenes/mirror_room/scene.toml", "--spp", "4", "--no-figures", "-o", room);
  writeFileSync(plan, PLAN(join(ROOT, "rigs/spatio_polarimetric/rig.toml")));
  sunstone("rig", "run", plan, "--sample", "mirror", "-o", captures);
  sunstone("view", room, "--export", exported);
  const server = await view(room, captures);
  const files = await fileServer(exported);
  const bench: Bench = { folder, room, captures, address: server.ready[0], exported: files.address };
  process.env.VIEW_BENCH = JSON.stringify(bench);
  return async () => {
    await Promise.all([stop(server), stop(files)]);
    rmSync(folder, { recursive: true });
  };
}
