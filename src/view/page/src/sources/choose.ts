/** Chooses where the page gets its data. */

import type { Source } from "./source";
import { ServerSource } from "./server";
import { StaticSource } from "./static";

/** Folder of the data of a static export, beside the page. */
const STATIC_FOLDER = "data";

/** Returns the source of this page: the server if the URL has its token, otherwise the files of a static export, if there are any. */
export async function chooseSource(location: Location): Promise<Source> {
  const token = new URLSearchParams(location.search).get("token");
  if (token !== null) return new ServerSource(token);
  const found = await fetch(`${STATIC_FOLDER}/describe.json`).catch(() => null);
  return found?.ok === true ? new StaticSource(STATIC_FOLDER) : new ServerSource("");
}
