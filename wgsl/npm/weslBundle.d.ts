/** A bundle for the linker of the npm package `wesl`. */
export interface WeslBundle {
  name: string;
  edition: string;
  modules: Record<string, string>;
  dependencies?: WeslBundle[];
}

export declare const weslBundle: WeslBundle;
export default weslBundle;
