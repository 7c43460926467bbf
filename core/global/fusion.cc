#include "core/global/fusion.h"

#include <algorithm>
#include <cmath>

namespace gem {
namespace {

// A cell that is fused again and again on a loop never becomes surer than the local mapper's floor:
// the gate would close, and noise would pass for change.
constexpr float kVarianceFloor_m2 = 1e-4f;

// Share of a in a fused value.
double WeightOf(float variance_a_m2, float variance_b_m2) {
  const double sum = static_cast<double>(variance_a_m2) + variance_b_m2;
  return sum > 0 ? variance_b_m2 / sum : 0.5;
}

float Blend(float a, float b, double weight_a) {
  return static_cast<float>(b + weight_a * (static_cast<double>(a) - b));
}

Rgba BlendColor(Rgba a, Rgba b, double weight_a) {
  Rgba blended = 0xff000000u;
  for (int shift = 0; shift < 24; shift += 8) {
    const auto channel = [shift](Rgba rgba) { return static_cast<float>((rgba >> shift) & 0xffu); };
    blended |= static_cast<Rgba>(std::lround(Blend(channel(a), channel(b), weight_a))) << shift;
  }
  return blended;
}

// What CellBelief and SubmapCell have in common, apart from the uncertainty.
template <typename Cell>
Cell FuseValues(const Cell& a, const Cell& b, double weight_a) {
  Cell fused = a;
  fused.elevation_m = Blend(a.elevation_m, b.elevation_m, weight_a);
  if ((a.state & b.state & kCellAnnotated) != 0)
    fused.traversability = Blend(a.traversability, b.traversability, weight_a);
  else if ((b.state & kCellAnnotated) != 0)
    fused.traversability = b.traversability;
  if ((a.state & b.state & kCellColored) != 0)
    fused.rgba = BlendColor(a.rgba, b.rgba, weight_a);
  else if ((b.state & kCellColored) != 0)
    fused.rgba = b.rgba;
  fused.stamp_ns = std::max(a.stamp_ns, b.stamp_ns);
  fused.state = a.state | b.state;
  return fused;
}

float FusedVariance(float a_m2, float b_m2) {
  const double sum = static_cast<double>(a_m2) + b_m2;
  const float fused = sum > 0 ? static_cast<float>(a_m2 * (b_m2 / sum)) : 0.0f;
  return std::max(fused, std::min({kVarianceFloor_m2, a_m2, b_m2}));
}

}  // namespace

bool Agree(float elevation_a_m, float variance_a_m2, float elevation_b_m, float variance_b_m2,
           float gate_sigmas) {
  const double difference_m = static_cast<double>(elevation_a_m) - elevation_b_m;
  const double variance_m2 = static_cast<double>(variance_a_m2) + variance_b_m2;
  return difference_m * difference_m <=
         static_cast<double>(gate_sigmas) * gate_sigmas * variance_m2;
}

CellBelief Fuse(const CellBelief& a, const CellBelief& b) {
  CellBelief fused = FuseValues(a, b, WeightOf(a.variance_m2, b.variance_m2));
  fused.variance_m2 = FusedVariance(a.variance_m2, b.variance_m2);
  return fused;
}

SubmapCell Fuse(const SubmapCell& a, const SubmapCell& b) {
  const float zz_a = HeightVariance(a.covariance_m2);
  const float zz_b = HeightVariance(b.covariance_m2);
  const double weight_a = WeightOf(zz_a, zz_b);
  SubmapCell fused = FuseValues(a, b, weight_a);
  for (std::size_t i = 0; i < fused.covariance_m2.size(); ++i)
    fused.covariance_m2[i] = Blend(a.covariance_m2[i], b.covariance_m2[i], weight_a);
  // Scaling row and column of z keeps the blend a covariance matrix.
  const float zz = FusedVariance(zz_a, zz_b);
  const float blended_zz = fused.covariance_m2[5];
  const float scale = blended_zz > 0 ? std::sqrt(zz / blended_zz) : 0.0f;
  fused.covariance_m2[2] *= scale;
  fused.covariance_m2[4] *= scale;
  fused.covariance_m2[5] = zz;
  return fused;
}

}  // namespace gem
