#include "proto/wire/cell_codec.h"

#include <algorithm>

#include "core/base/check.h"
#include "proto/wire/zigzag.h"

namespace gem::wire {
namespace {

constexpr std::size_t kChannels = 4;  ///< of a colour

/// Median of left, lower and left + lower - corner: the plane through the three, which never goes
/// beyond left or lower, so that it stops at edges and needs no more bits than they do.
int Median(int left, int lower, int corner) {
  const int low = std::min(left, lower);
  const int high = std::max(left, lower);
  return std::clamp(left + lower - corner, low, high);
}

/// Foretells cells in their order from those before them. At(i) is a cell's value, already known.
class Predictor {
 public:
  explicit Predictor(const CellMask& mask) : mask_(mask) {}

  /// Of cell i, which is valid; each valid cell once, in order.
  template <typename At>
  int Predict(std::size_t i, At at) {
    const std::size_t column = i % mask_.columns;
    const bool left = column > 0 && Valid(i - 1);
    const bool has_row_below = i >= mask_.columns;
    const std::size_t below = i - mask_.columns;
    const bool lower = has_row_below && Valid(below);
    const bool corner = has_row_below && column > 0 && Valid(below - 1);
    const std::size_t last = last_;
    const bool is_first = first_;
    last_ = i;
    first_ = false;
    if (left && lower)
      // Without the corner: their mean, rounded down.
      return corner ? Median(at(i - 1), at(below), at(below - 1)) : (at(i - 1) + at(below)) >> 1;
    if (left) return at(i - 1);
    if (lower) return at(below);
    if (corner) return at(below - 1);
    if (has_row_below && column + 1 < mask_.columns && Valid(below + 1)) return at(below + 1);
    return is_first ? 0 : at(last);
  }

 private:
  bool Valid(std::size_t i) const { return mask_.valid[i] != 0; }

  const CellMask& mask_;
  std::size_t last_ = 0;  ///< valid cell before
  bool first_ = true;
};

}  // namespace

std::size_t CellMask::num_valid() const {
  return static_cast<std::size_t>(
      std::count_if(valid.begin(), valid.end(), [](std::uint8_t v) { return v != 0; }));
}

std::string EncodeCells(std::span<const std::int16_t> cells, const CellMask& mask) {
  const std::size_t num_valid = mask.num_valid();
  std::string data(2 * num_valid, '\0');
  Predictor predictor(mask);
  std::size_t k = 0;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    if (mask.valid[i] == 0) continue;
    const int predicted = predictor.Predict(i, [&](std::size_t at) { return int{cells[at]}; });
    const auto code = Zigzag(static_cast<std::uint16_t>(cells[i] - predicted));
    data[k] = static_cast<char>(code & 0xff);
    data[num_valid + k] = static_cast<char>(code >> 8);
    ++k;
  }
  return data;
}

std::vector<std::int16_t> DecodeCells(absl::string_view data, const CellMask& mask) {
  const std::size_t num_valid = mask.num_valid();
  GEM_CHECK(data.size() == 2 * num_valid);
  std::vector<std::int16_t> cells(mask.valid.size());
  Predictor predictor(mask);
  std::size_t k = 0;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    if (mask.valid[i] == 0) continue;
    const auto code = static_cast<std::uint16_t>(
        static_cast<std::uint8_t>(data[k]) | static_cast<std::uint8_t>(data[num_valid + k]) << 8);
    const int predicted = predictor.Predict(i, [&](std::size_t at) { return int{cells[at]}; });
    cells[i] = static_cast<std::int16_t>(predicted + static_cast<std::int16_t>(Unzigzag(code)));
    ++k;
  }
  return cells;
}

std::string EncodeCells(std::span<const Rgba> cells, const CellMask& mask) {
  std::string data;
  data.reserve(kChannels * mask.num_valid());
  for (std::size_t channel = 0; channel < kChannels; ++channel) {
    const auto at = [&](std::size_t i) {
      return static_cast<int>((cells[i] >> (8 * channel)) & 0xffu);
    };
    Predictor predictor(mask);
    for (std::size_t i = 0; i < cells.size(); ++i)
      if (mask.valid[i] != 0)
        data.push_back(
            static_cast<char>(Zigzag(static_cast<std::uint8_t>(at(i) - predictor.Predict(i, at)))));
  }
  return data;
}

std::vector<Rgba> DecodeColors(absl::string_view data, const CellMask& mask) {
  GEM_CHECK(data.size() == kChannels * mask.num_valid());
  std::vector<Rgba> cells(mask.valid.size());
  std::size_t k = 0;
  for (std::size_t channel = 0; channel < kChannels; ++channel) {
    const auto at = [&](std::size_t i) {
      return static_cast<int>((cells[i] >> (8 * channel)) & 0xffu);
    };
    Predictor predictor(mask);
    for (std::size_t i = 0; i < cells.size(); ++i) {
      if (mask.valid[i] == 0) continue;
      const auto code = static_cast<std::uint8_t>(data[k++]);
      const int value = predictor.Predict(i, at) + Unzigzag(code);
      cells[i] |= static_cast<Rgba>(static_cast<std::uint8_t>(value)) << (8 * channel);
    }
  }
  return cells;
}

}  // namespace gem::wire
