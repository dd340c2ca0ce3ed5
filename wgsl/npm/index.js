import { modules } from "./modules.js";

export { modules };

/** The module of this name (`"sample/cone"`), if there is one. */
export const module = (name) => modules.find((m) => m.name === name);

/** The named modules and all that they require, each once, dependencies first. */
export function linked(names) {
  const out = [];
  const visit = (name, requiredBy) => {
    if (out.some((m) => m.name === name)) return;
    const found = module(name);
    if (!found) {
      const by = requiredBy ? `, which \`${requiredBy}\` requires` : "";
      throw new Error(`no WGSL module is named \`${name}\`${by}; \`modules\` lists those that exist`);
    }
    for (const need of found.requires) visit(need, name);
    out.push(found);
  };
  for (const name of names) visit(name);
  return out;
}

/** One WGSL source with the named modules and all that they require. */
export const link = (names) =>
  linked(names)
    .map((m) => m.source)
    .join("\n");
