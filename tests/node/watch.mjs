// README.md, point 7: puts the parts of WatchTiles and StreamTiles together.
export const keyOf = ({ level, x, y }) => `${level}/${x}/${y}`;

export class WatchedTiles {
  tiles = new Map(); // key to Tile, of `version`
  version = null; // the last complete one
  numChanges = 0;
  #gathered = new Map();
  #reset = false;

  /// True if the change is complete and was applied.
  take(part) {
    if (part.reset) {
      this.#gathered.clear();
      this.#reset = true;
    }
    for (const tile of part.tiles) this.#gathered.set(keyOf(tile.key), tile);
    if (!part.complete) return false;
    if (this.#reset) this.tiles = new Map();
    for (const [key, tile] of this.#gathered) {
      if (tile.absent) this.tiles.delete(key);
      else this.tiles.set(key, tile);
    }
    this.#gathered = new Map();
    this.#reset = false;
    this.version = part.version;
    ++this.numChanges;
    return true;
  }
}
