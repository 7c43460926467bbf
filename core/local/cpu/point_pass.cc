#include "core/local/cpu/point_pass.h"

#include <bit>
#include <cmath>
#include <limits>

namespace gem::cpu {
namespace {

// Points that are handled together. Their intermediate values stay in the first-level cache.
constexpr std::size_t kBlock = 256;
// Points whose bits fill a word.
constexpr std::size_t kGroup = 32;

struct Block {
  alignas(64) std::int32_t ray_place[kBlock];
  alignas(64) float ray_slope[kBlock];
  alignas(64) std::int32_t over_window[kBlock];  // 1: perhaps in the window, 0: surely not
};

// How many points pass the tests of MeasureBeam up to here.
struct Passed {
  std::int32_t range = 0, body = 0, low = 0, high = 0;
};

// What lies farther below zero is not in cell 0, however the quotient is rounded.
constexpr float kRounding_m = 1e-6f;

// Coordinates over the window that might divide into a cell of it are at most this.
float SpanOver(const ScanFrame& frame) {
  const float span_m = static_cast<float>(frame.side_cells) * frame.cell_size_m;
  return std::nextafter(span_m, std::numeric_limits<float>::infinity());
}

// MeasureBeam and RayTo of a block's points without branches. The cell is left to SeeHits, which
// divides: most points of a scan lie outside the window.
template <bool kHasBody>
void SeeBlock(const ScanFrame& frame_in, const RayBins& bins_in, float span_m, std::int32_t limit,
              const ScanPoint* points, std::size_t count, Block& block, Passed& passed) {
  const ScanFrame frame = frame_in;  // copies, which stores below cannot change
  const RayBins bins = bins_in;
  std::int32_t* __restrict place = block.ray_place;
  float* __restrict slope = block.ray_slope;
  std::int32_t* __restrict over_window = block.over_window;
  std::int32_t num_range = 0, num_body = 0, num_low = 0, num_high = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const bool in_range = InRange(frame, Range2Of(points[i]));
    // What is out of range may overflow: it goes on as the sensor's own place.
    const ScanPoint p_S{in_range ? points[i].x_m : 0.0f, in_range ? points[i].y_m : 0.0f,
                        in_range ? points[i].z_m : 0.0f, 0};
    const bool off_body = kHasBody ? in_range & !InBody(frame, p_S) : in_range;
    const Offset offset = OffsetOf(frame, p_S);
    const float height_m = offset.z_m + frame.sensor_over_base_m;
    const bool not_low = off_body & !(height_m < frame.height_m_min);
    const bool not_high = not_low & !(height_m > frame.height_m_max);
    const RayPlace ray = RayPlaceOf(RayTo(offset.x_m, offset.y_m, offset.z_m, bins), bins, limit);
    place[i] = ray.index;
    slope[i] = not_low ? ray.slope : kNoRay;
    const float x_m = frame.sensor_x_m + offset.x_m, y_m = frame.sensor_y_m + offset.y_m;
    const bool inside = (x_m > -kRounding_m) & (x_m <= span_m) &  //
                        (y_m > -kRounding_m) & (y_m <= span_m);
    over_window[i] = (not_high & inside) ? 1 : 0;
    num_range += static_cast<std::int32_t>(in_range);
    num_body += static_cast<std::int32_t>(off_body);
    num_low += static_cast<std::int32_t>(not_low);
    num_high += static_cast<std::int32_t>(not_high);
  }
  passed.range += num_range;
  passed.body += num_body;
  passed.low += num_low;
  passed.high += num_high;
}

std::uint32_t BitsOf(const std::int32_t* flags) {
  std::uint32_t bits = 0;
  for (std::size_t i = 0; i < kGroup; ++i) bits |= static_cast<std::uint32_t>(flags[i]) << i;
  return bits;
}

struct Hits {
  alignas(64) std::uint32_t cell[kGroup];
  alignas(64) float elevation_m[kGroup];
  alignas(64) float variance_m2[kGroup];
  alignas(64) std::int32_t inside[kGroup];
};

// Cells and heights of a group, of which some points lie over the window. The others are measured
// along with them, as if they lay where the sensor is, and not listed.
void SeeHits(const ScanFrame& frame_in, const ScanPoint* points, const std::int32_t* over_window,
             std::size_t count, Hits& hits) {
  const ScanFrame frame = frame_in;
  const auto side = static_cast<std::uint32_t>(frame.side_cells);
  std::uint32_t* __restrict cell = hits.cell;
  float* __restrict elevation_m = hits.elevation_m;
  float* __restrict variance_m2 = hits.variance_m2;
  std::int32_t* __restrict in_window = hits.inside;
  for (std::size_t i = 0; i < count; ++i) {
    const bool over = over_window[i] != 0;
    const float x_m = points[i].x_m, y_m = points[i].y_m, z_m = points[i].z_m;
    const ScanPoint p_S{over ? x_m : 0.0f, over ? y_m : 0.0f, over ? z_m : 0.0f, 0};
    const Offset offset = OffsetOf(frame, p_S);
    const WindowPlace place = WindowPlaceOf(frame, offset);
    const bool inside = over & InWindow(frame, place);
    const auto column = static_cast<std::int32_t>(place.column);
    const auto row = static_cast<std::int32_t>(place.row);
    const Beam beam{offset.x_m,           offset.y_m, offset.z_m, std::sqrt(Range2Of(p_S)),
                    PointFate::kInWindow, column,     row};
    cell[i] = static_cast<std::uint32_t>(row) * side + static_cast<std::uint32_t>(column);
    elevation_m[i] = ElevationOf(frame, beam);
    variance_m2[i] = SensorVarianceOf(frame, p_S, beam);
    in_window[i] = inside ? 1 : 0;
  }
}

// Where the next hit is listed. Pointers, for the lists are long enough by now.
struct Lists {
  std::uint32_t* cell;
  Height* height;
  Rgba* rgba;
  std::uint32_t* count_of_cell;
  std::uint32_t* touched;
  std::size_t num_hits, num_touched;
  Rgba any_rgba;
};

void List(const Hits& hits, const ScanPoint* points, std::uint32_t bits, Lists& lists) {
  for (; bits != 0; bits &= bits - 1) {
    const auto i = static_cast<std::size_t>(std::countr_zero(bits));
    if (hits.inside[i] == 0) continue;
    const std::uint32_t cell = hits.cell[i];
    lists.cell[lists.num_hits] = cell;
    lists.height[lists.num_hits] = {hits.elevation_m[i], hits.variance_m2[i]};
    lists.rgba[lists.num_hits] = points[i].rgba;
    lists.any_rgba |= points[i].rgba;
    ++lists.num_hits;
    const std::uint32_t before = lists.count_of_cell[cell]++;
    lists.touched[lists.num_touched] = cell;  // unless it is, the next one takes the place
    lists.num_touched += before == 0 ? 1 : 0;
  }
}

template <bool kHasBody>
void MeasureBlocks(const ScanFrame& frame, std::span<const ScanPoint> points, std::int32_t limit,
                   RayTable& rays, Lists& lists, Passed& passed) {
  const float span_m = SpanOver(frame);
  Block block;
  Hits hits;
  for (std::size_t begin = 0; begin < points.size(); begin += kBlock) {
    const std::size_t count = std::min(kBlock, points.size() - begin);
    const ScanPoint* from = points.data() + begin;
    SeeBlock<kHasBody>(frame, rays.bins(), span_m, limit, from, count, block, passed);
    rays.Add(block.ray_place, block.ray_slope, count);
    std::fill(block.over_window + count, block.over_window + kBlock, 0);
    for (std::size_t first = 0; first < count; first += kGroup) {
      const std::uint32_t bits = BitsOf(block.over_window + first);
      if (bits == 0) continue;
      const std::size_t group = std::min(kGroup, count - first);
      SeeHits(frame, from + first, block.over_window + first, group, hits);
      List(hits, from + first, bits, lists);
    }
  }
}

}  // namespace

void MeasurePoints(VectorSet set, const ScanFrame& frame, std::span<const ScanPoint> points,
                   std::int32_t range_bin_limit, MeasuredPart& part) {
  if (part.cell.size() < points.size()) {
    part.cell.resize(points.size());
    part.height.resize(points.size());
    part.rgba.resize(points.size());
  }
  Passed passed;
  Lists lists{part.cell.data(),
              part.height.data(),
              part.rgba.data(),
              part.count_of_cell.data(),
              part.touched.data(),
              0,
              0,
              0};
  RunVectorised(set, [&] {
    part.rays.Reset(range_bin_limit);
    if (frame.has_body) {
      MeasureBlocks<true>(frame, points, range_bin_limit, part.rays, lists, passed);
    } else {
      MeasureBlocks<false>(frame, points, range_bin_limit, part.rays, lists, passed);
    }
  });
  part.num_hits = lists.num_hits;
  part.num_touched = lists.num_touched;
  part.is_colored = HasColor(lists.any_rgba);
  const auto num_hits = static_cast<std::int32_t>(lists.num_hits);
  const auto count = [&](PointFate fate, std::int32_t num_points) {
    part.fates[static_cast<std::size_t>(fate)] = static_cast<std::uint32_t>(num_points);
  };
  count(PointFate::kOutOfRange, static_cast<std::int32_t>(points.size()) - passed.range);
  count(PointFate::kOnBody, passed.range - passed.body);
  count(PointFate::kTooLow, passed.body - passed.low);
  count(PointFate::kTooHigh, passed.low - passed.high);
  count(PointFate::kOutsideWindow, passed.high - num_hits);
  count(PointFate::kInWindow, num_hits);
}

}  // namespace gem::cpu
