/** One WGSL text and what it stands on. */
export interface Module {
  /** Path of the technique, `group/name`. */
  readonly name: string;
  /** The text: declarations only. */
  readonly source: string;
  /** Modules whose declarations it uses. */
  readonly requires: readonly string[];
  /** Functions that the program must define for it, as WGSL signatures. */
  readonly callbacks: readonly string[];
  /** Ready bindings that define those functions over storage buffers. */
  readonly bindings: string | null;
}

/** All modules. */
export const modules: readonly Module[];

/** The module of this name (`"sample/cone"`), if there is one. */
export function module(name: string): Module | undefined;

/**
 * The named modules and all that they require, each once, dependencies first.
 * @throws if there is no module of a name
 */
export function linked(names: readonly string[]): Module[];

/**
 * One WGSL source with the named modules and all that they require.
 * @throws if there is no module of a name
 */
export function link(names: readonly string[]): string;
