#include "core/local/cpu/point_pass.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

namespace gem::cpu {
namespace {

// Points that are handled together. Their intermediate values stay in the first-level cache.
constexpr std::size_t kBlock = 256;
// Points whose bits fill a word.
constexpr std::size_t kGroup = 32;

struct Block {
  alignas(64) float x_m[kBlock], y_m[kBlock], z_m[kBlock];
  alignas(64) Rgba rgba[kBlock];
  alignas(64) std::int32_t ray_place[kBlock];
  alignas(64) float ray_slope[kBlock];
  alignas(64) std::int32_t azimuth_bin[kBlock];
  alignas(64) std::int32_t over_window[kBlock];  // 1: perhaps in the window, 0: surely not
};

// How many points pass the tests of MeasureBeam up to here.
struct Passed {
  std::int32_t points = 0, range = 0, body = 0, low = 0, high = 0;
  Rgba any_rgba = 0;  // of all points, bit by bit
};

// What lies farther below zero is not in cell 0, however the quotient is rounded.
constexpr float kRounding_m = 1e-6f;
// The place of no point: it is out of every range.
constexpr float kNowhere_m = std::numeric_limits<float>::quiet_NaN();

// Coordinates over the window that might divide into a cell of it are at most this.
float SpanOver(const ScanFrame& frame) {
  const float span_m = static_cast<float>(frame.side_cells) * frame.cell_size_m;
  return std::nextafter(span_m, std::numeric_limits<float>::infinity());
}

// Points that lie one after the other become coordinates side by side.
template <bool kIsFull>
void Unpack(std::span<const ScanPoint> points, std::size_t num_groups, Block& block) {
  // As values of one type: a compiler does not load a whole point if it is told of a part of it.
  static_assert(sizeof(ScanPoint) == 4 * sizeof(float));
  alignas(64) float values[4 * kBlock];
  std::memcpy(values, points.data(), points.size_bytes());
  for (std::size_t i = 0; i < (kIsFull ? kBlock : num_groups * kGroup); ++i) {
    block.x_m[i] = values[4 * i];
    block.y_m[i] = values[4 * i + 1];
    block.z_m[i] = values[4 * i + 2];
    block.rgba[i] = std::bit_cast<Rgba>(values[4 * i + 3]);
  }
}

template <bool kIsFull>
void Unpack(const PackedPoints& packed, std::size_t begin, std::size_t count,
            std::size_t num_groups, Block& block) {
  std::fill(block.rgba, block.rgba + num_groups * kGroup, Rgba{0});
  if (!packed.is_tight()) {
    for (std::size_t i = 0; i < count; ++i) {
      const ScanPoint point = PointAt(packed, begin + i);
      block.x_m[i] = point.x_m;
      block.y_m[i] = point.y_m;
      block.z_m[i] = point.z_m;
    }
    return;
  }
  alignas(64) std::int16_t values[3 * kBlock];
  alignas(64) float wide[3 * kBlock];
  std::memcpy(values, packed.bytes + begin * packed.stride, count * packed.stride);
  const std::size_t num_points = kIsFull ? kBlock : num_groups * kGroup;
  for (std::size_t i = 0; i < 3 * num_points; ++i) wide[i] = static_cast<float>(values[i]);
  const auto [x_m, y_m, z_m] = packed.scale_m;
  for (std::size_t i = 0; i < num_points; ++i) {
    block.x_m[i] = wide[3 * i] * x_m;
    block.y_m[i] = wide[3 * i + 1] * y_m;
    block.z_m[i] = wide[3 * i + 2] * z_m;
  }
}

// The scan's points [begin, end). Behind the last one come points that are nowhere, up to a whole
// group: no loop over a block ends in one without vectors. Returns how many groups that makes.
template <bool kIsFull>
std::size_t UnpackBlock(const Scan& scan, std::size_t begin, std::size_t end, Block& block) {
  const std::size_t count = end - begin;
  const std::size_t num_groups = (count + kGroup - 1) / kGroup;
  if (scan.packed.count != 0) {
    Unpack<kIsFull>(scan.packed, begin, count, num_groups, block);
  } else {
    Unpack<kIsFull>(scan.points.subspan(begin, count), num_groups, block);
  }
  std::fill(block.x_m + count, block.x_m + num_groups * kGroup, kNowhere_m);
  std::fill(block.rgba + count, block.rgba + num_groups * kGroup, Rgba{0});
  return num_groups;
}

// What SeeBlock counts of a block.
struct BlockCounts {
  std::int32_t over = 0;    // points that may lie over the window
  std::int32_t strays = 0;  // rays into other sectors
};

// MeasureBeam and RayTo of a block's points without branches. The cell is left to SeeHits, which
// divides: most points of a scan lie outside the window. A ray that says nothing gets a place in
// the sector, so that adding it harms nobody.
template <bool kHasBody, bool kIsFull>
BlockCounts SeeBlock(const ScanFrame& frame_in, const RayTable& rays,
                     const AzimuthSector& sector_in, float span_m, std::size_t num_groups,
                     Block& block, Passed& passed) {
  const ScanFrame frame = frame_in;  // copies, which stores below cannot change
  const RayBins bins = rays.bins();
  const std::int32_t limit = rays.limit();
  const AzimuthSector sector = sector_in;
  std::int32_t num_range = 0, num_body = 0, num_low = 0, num_high = 0, num_over = 0;
  std::int32_t num_strays = 0;
  Rgba any_rgba = 0;
  GEM_INDEPENDENT
  for (std::size_t i = 0; i < (kIsFull ? kBlock : num_groups * kGroup); ++i) {
    const float x_m = block.x_m[i], y_m = block.y_m[i], z_m = block.z_m[i];
    const bool in_range = InRange(frame, Range2Of({x_m, y_m, z_m, 0}));
    // What is out of range may overflow: it goes on as the sensor's own place.
    const ScanPoint p_S{in_range ? x_m : 0.0f, in_range ? y_m : 0.0f, in_range ? z_m : 0.0f, 0};
    const bool off_body = kHasBody ? in_range & !InBody(frame, p_S) : in_range;
    const Offset offset = OffsetOf(frame, p_S);
    const float height_m = offset.z_m + frame.sensor_over_base_m;
    const bool not_low = off_body & !(height_m < frame.height_m_min);
    const bool not_high = not_low & !(height_m > frame.height_m_max);
    const Ray ray = RayTo(offset.x_m, offset.y_m, offset.z_m, bins);
    const RayPlace place = RayPlaceOf(ray, bins, limit);
    const std::int32_t azimuth_bin = not_low ? ray.azimuth_bin : sector.begin;
    block.azimuth_bin[i] = azimuth_bin;
    block.ray_place[i] = not_low ? place.index : sector.begin;
    block.ray_slope[i] = not_low ? place.slope : kNoRay;
    num_strays += sector.Holds(azimuth_bin) ? 0 : 1;
    const float over_x_m = frame.sensor_x_m + offset.x_m;
    const float over_y_m = frame.sensor_y_m + offset.y_m;
    const bool inside = (over_x_m > -kRounding_m) & (over_x_m <= span_m) &  //
                        (over_y_m > -kRounding_m) & (over_y_m <= span_m);
    const std::int32_t over_window = (not_high & inside) ? 1 : 0;
    block.over_window[i] = over_window;
    num_over += over_window;
    any_rgba |= block.rgba[i];
    num_range += static_cast<std::int32_t>(in_range);
    num_body += static_cast<std::int32_t>(off_body);
    num_low += static_cast<std::int32_t>(not_low);
    num_high += static_cast<std::int32_t>(not_high);
  }
  passed.range += num_range;
  passed.body += num_body;
  passed.low += num_low;
  passed.high += num_high;
  passed.any_rgba |= any_rgba;
  return {num_over, num_strays};
}

// Where the next hit is listed. Pointers, for the lists are long enough by now.
struct Lists {
  explicit Lists(MeasuredPart& part)
      : cell(part.cell.data()),
        elevation_m(part.elevation_m.data()),
        variance_m2(part.variance_m2.data()),
        rgba(part.rgba.data()),
        count_of_cell(part.count_of_cell.data()),
        strays(part.strays.data()) {}

  std::uint32_t* cell;
  float* elevation_m;
  float* variance_m2;
  Rgba* rgba;
  std::uint32_t* count_of_cell;
  StrayRay* strays;
  std::size_t num_hits = 0, num_strays = 0;
  bool is_colored = false;
};

std::uint32_t BitsOf(const std::int32_t* flags) {
  std::uint32_t bits = 0;
  for (std::size_t i = 0; i < kGroup; ++i) bits |= static_cast<std::uint32_t>(flags[i]) << i;
  return bits;
}

// Keeps the block's rays into other sectors, and puts rays that say nothing in their place.
void KeepStrays(const AzimuthSector& sector, std::size_t num_groups, Block& block, Lists& lists) {
  alignas(64) std::int32_t is_stray[kGroup];
  for (std::size_t first = 0; first < num_groups * kGroup; first += kGroup) {
    for (std::size_t i = 0; i < kGroup; ++i)
      is_stray[i] = sector.Holds(block.azimuth_bin[first + i]) ? 0 : 1;
    for (std::uint32_t bits = BitsOf(is_stray); bits != 0; bits &= bits - 1) {
      const std::size_t i = first + static_cast<std::size_t>(std::countr_zero(bits));
      lists.strays[lists.num_strays++] = {{block.ray_place[i], block.ray_slope[i]},
                                          block.azimuth_bin[i]};
      block.ray_place[i] = sector.begin;
      block.ray_slope[i] = kNoRay;
    }
  }
}

struct Hits {
  alignas(64) std::uint32_t cell[kGroup];
  alignas(64) float elevation_m[kGroup];
  alignas(64) float variance_m2[kGroup];
  alignas(64) Rgba rgba[kGroup];
  alignas(64) std::int32_t inside[kGroup];
};

// Cells and heights of the group from `first` on, of which some points lie over the window. The
// others are measured along with them, as if they lay where the sensor is, and not listed.
void SeeHits(const ScanFrame& frame_in, const Block& block, std::size_t first, Hits& hits) {
  const ScanFrame frame = frame_in;
  const auto side = static_cast<std::uint32_t>(frame.side_cells);
  GEM_INDEPENDENT
  for (std::size_t i = 0; i < kGroup; ++i) {
    const bool over = block.over_window[first + i] != 0;
    const float x_m = block.x_m[first + i], y_m = block.y_m[first + i], z_m = block.z_m[first + i];
    const ScanPoint p_S{over ? x_m : 0.0f, over ? y_m : 0.0f, over ? z_m : 0.0f, 0};
    const Offset offset = OffsetOf(frame, p_S);
    const WindowPlace place = WindowPlaceOf(frame, offset);
    const bool inside = over & InWindow(frame, place);
    const auto column = static_cast<std::int32_t>(place.column);
    const auto row = static_cast<std::int32_t>(place.row);
    const Beam beam{offset.x_m,           offset.y_m, offset.z_m, std::sqrt(Range2Of(p_S)),
                    PointFate::kInWindow, column,     row};
    hits.cell[i] = static_cast<std::uint32_t>(row) * side + static_cast<std::uint32_t>(column);
    hits.elevation_m[i] = ElevationOf(frame, beam);
    hits.variance_m2[i] = SensorVarianceOf(frame, p_S, beam);
    hits.rgba[i] = block.rgba[first + i];
    hits.inside[i] = inside ? 1 : 0;
  }
}

// Moves the hits that are marked by bits to the front, and says how many there are.
std::size_t Compact(std::uint32_t bits, Hits& hits) {
  if (bits == ~0u) return kGroup;
  std::size_t count = 0;
  for (; bits != 0; bits &= bits - 1) {
    const auto i = static_cast<std::size_t>(std::countr_zero(bits));
    hits.cell[count] = hits.cell[i];
    hits.elevation_m[count] = hits.elevation_m[i];
    hits.variance_m2[count] = hits.variance_m2[i];
    hits.rgba[count] = hits.rgba[i];
    ++count;
  }
  return count;
}

// Adds the first `count` hits, at least one, to the counts of their cells. A LiDAR's next beam
// mostly ends in the cell of the last one, and to add one by one is to wait for the last sum.
void CountHits(const Hits& hits, std::size_t count, std::uint32_t* count_of_cell) {
  alignas(64) std::int32_t begins[kGroup];  // another cell than the hit before
  begins[0] = 1;
  for (std::size_t i = 1; i < kGroup; ++i) begins[i] = hits.cell[i] != hits.cell[i - 1] ? 1 : 0;
  std::uint32_t bits = BitsOf(begins) & (~0u >> (kGroup - count));
  while (bits != 0) {
    const int begin = std::countr_zero(bits);
    bits &= bits - 1;
    const int end = bits != 0 ? std::countr_zero(bits) : static_cast<int>(count);
    count_of_cell[hits.cell[begin]] += static_cast<std::uint32_t>(end - begin);
  }
}

// The hits of a run, lane by lane of the groups.
struct CellBounds {
  alignas(64) std::uint32_t min[kGroup];
  alignas(64) std::uint32_t max[kGroup];

  CellBounds() {
    std::fill_n(min, kGroup, ~0u);
    std::fill_n(max, kGroup, 0u);
  }
  void Add(const Hits& hits) {
    for (std::size_t i = 0; i < kGroup; ++i) {
      const bool inside = hits.inside[i] != 0;
      const std::uint32_t low = inside ? hits.cell[i] : ~0u, high = inside ? hits.cell[i] : 0u;
      min[i] = low < min[i] ? low : min[i];
      max[i] = high > max[i] ? high : max[i];
    }
  }
  std::uint32_t Min() const { return *std::min_element(min, min + kGroup); }
  std::uint32_t Max() const { return *std::max_element(max, max + kGroup); }
};

void List(std::uint32_t bits, Hits& hits, Lists& lists) {
  const std::size_t count = Compact(bits, hits);
  if (count == 0) return;
  // Always a whole group: what lies behind the last hit is overwritten by the next ones.
  std::copy_n(hits.cell, kGroup, lists.cell + lists.num_hits);
  std::copy_n(hits.elevation_m, kGroup, lists.elevation_m + lists.num_hits);
  std::copy_n(hits.variance_m2, kGroup, lists.variance_m2 + lists.num_hits);
  if (lists.is_colored) std::copy_n(hits.rgba, kGroup, lists.rgba + lists.num_hits);
  CountHits(hits, count, lists.count_of_cell);
  lists.num_hits += count;
}

template <bool kHasBody, bool kIsFull>
void MeasureBlock(const PointPass& pass, std::size_t begin, std::size_t end, float span_m,
                  const AzimuthSector& sector, Block& block, CellBounds& bounds, Lists& lists,
                  Passed& passed) {
  const std::size_t num_groups = UnpackBlock<kIsFull>(pass.scan, begin, end, block);
  const BlockCounts counts =
      SeeBlock<kHasBody, kIsFull>(pass.frame, pass.rays, sector, span_m, num_groups, block, passed);
  if (counts.strays != 0) KeepStrays(sector, num_groups, block, lists);
  pass.rays.Add(block.ray_place, block.ray_slope, num_groups * kGroup);
  if (!lists.is_colored && HasColor(passed.any_rgba)) {
    lists.is_colored = true;
    std::fill_n(lists.rgba, lists.num_hits, Rgba{0});
  }
  if (counts.over == 0) return;
  Hits hits;
  for (std::size_t first = 0; first < num_groups * kGroup; first += kGroup) {
    if (BitsOf(block.over_window + first) == 0) continue;
    SeeHits(pass.frame, block, first, hits);
    bounds.Add(hits);
    List(BitsOf(hits.inside), hits, lists);
  }
}

// Nearly all blocks are full, and loops over so many points as the compiler knows are faster.
template <bool kHasBody>
void MeasureRun(const PointPass& pass, std::size_t number, MeasuredPart& part, Lists& lists,
                Passed& passed) {
  const PointRun& run = pass.runs.runs()[number];
  const std::size_t first_hit = lists.num_hits;
  const float span_m = SpanOver(pass.frame);
  CellBounds bounds;
  Block block;
  std::size_t begin = run.begin;
  for (; begin + kBlock <= run.end; begin += kBlock) {
    MeasureBlock<kHasBody, true>(pass, begin, begin + kBlock, span_m, part.sector, block, bounds,
                                 lists, passed);
  }
  if (begin < run.end) {
    MeasureBlock<kHasBody, false>(pass, begin, run.end, span_m, part.sector, block, bounds, lists,
                                  passed);
  }
  passed.points += static_cast<std::int32_t>(run.end - run.begin);
  pass.hits[number] = {&part, first_hit, lists.num_hits, bounds.Min(), bounds.Max()};
}

void BeginPart(std::size_t num_points, bool has_strays, MeasuredPart& part) {
  const std::size_t num_listed = num_points + kGroup;
  if (part.cell.size() < num_listed) {
    part.cell.resize(num_listed);
    part.elevation_m.resize(num_listed);
    part.variance_m2.resize(num_listed);
    part.rgba.resize(num_listed);
    if (has_strays) part.strays.resize(num_listed);
  }
  part.fates = {};
}

void EndPart(const Lists& lists, const Passed& passed, MeasuredPart& part) {
  part.num_hits = lists.num_hits;
  part.num_strays = lists.num_strays;
  part.is_colored = lists.is_colored;
  const auto num_hits = static_cast<std::int32_t>(lists.num_hits);
  const auto count = [&](PointFate fate, std::int32_t num_points) {
    part.fates[static_cast<std::size_t>(fate)] = static_cast<std::uint32_t>(num_points);
  };
  count(PointFate::kOutOfRange, passed.points - passed.range);
  count(PointFate::kOnBody, passed.range - passed.body);
  count(PointFate::kTooLow, passed.body - passed.low);
  count(PointFate::kTooHigh, passed.low - passed.high);
  count(PointFate::kOutsideWindow, passed.high - num_hits);
  count(PointFate::kInWindow, num_hits);
}

}  // namespace

void MeasureRuns(const PointPass& pass, std::size_t thread, MeasuredPart& part) {
  BeginPart(pass.scan.num_points(), part.sector.size() < FullTurn(pass.rays.bins()).size(), part);
  pass.rays.Reset(part.sector);
  Lists lists(part);
  Passed passed;
  RunVectorised(pass.set, [&] {
    for (std::size_t run = pass.runs.Take(thread); run != PointRuns::kNone;
         run = pass.runs.Take(thread)) {
      if (pass.frame.has_body) {
        MeasureRun<true>(pass, run, part, lists, passed);
      } else {
        MeasureRun<false>(pass, run, part, lists, passed);
      }
    }
  });
  EndPart(lists, passed, part);
}

void AddStrays(std::span<const MeasuredPart> parts, std::size_t thread, RayTable& rays) {
  const AzimuthSector& sector = parts[thread].sector;
  for (const MeasuredPart& part : parts) {
    if (&part == &parts[thread]) continue;
    for (const StrayRay& ray : std::span(part.strays).first(part.num_strays))
      if (sector.Holds(ray.azimuth_bin)) rays.Add(&ray.place.index, &ray.place.slope, 1);
  }
}

}  // namespace gem::cpu
