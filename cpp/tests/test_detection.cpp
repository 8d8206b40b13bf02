// Detection without Python, to run under sanitizers: laws of the blobs of an image, and images of nothing.
#include <algorithm>
#include <cmath>

#include "check.hpp"
#include "sonocal/detection/blob_filter.hpp"
#include "sonocal/detection/gaussian_blur.hpp"

using namespace sonocal;

namespace {

constexpr int kRows = 96, kCols = 120;
using Image = std::vector<float>;

// A leaning ellipse on black.
Image echo(double u, double v) {
  Image image(kRows * kCols);
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kCols; ++c) {
      const double x = c - u, y = r - v, along = 0.8 * x + 0.6 * y, across = 0.8 * y - 0.6 * x;
      image[r * kCols + c] =
          static_cast<float>(200 * std::exp(-0.5 * (along * along / 12 + across * across / 5)));
    }
  return image;
}

Image mirrored(const Image& image) {
  Image out = image;
  for (int r = 0; r < kRows; ++r) std::reverse(&out[r * kCols], &out[r * kCols] + kCols);
  return out;
}

std::vector<Blob> blobs(const Image& image, const std::vector<unsigned char>& mask, bool first_echo = false,
                        int pool = 1) {
  BlobOptions options;
  options.first_echo = first_echo;
  return BlobFilter(mask.data(), kRows, kCols, {1.5, 3, 6, 12}, pool).detect(image.data(), options);
}

const std::vector<unsigned char> kEverywhere(kRows* kCols, 1);

bool same(const Blob& a, const Blob& b, double du, double dv) {
  return std::fabs(a.u + du - b.u) < 1e-2 && std::fabs(a.v + dv - b.v) < 1e-2 &&
         std::fabs(a.score - b.score) < 1e-2 * a.score && a.area == b.area;
}

void an_echo_is_found() {
  for (const int pool : {1, 2, 3}) {
    const auto found = blobs(echo(51.3, 40.8), kEverywhere, false, pool);
    check(!found.empty() && std::hypot(found[0].u - 51.3, found[0].v - 40.8) < 0.3, "an echo's middle");
  }
}

void a_moved_image_moves_the_blob() {
  for (const bool first_echo : {false, true}) {
    const auto here = blobs(echo(51.3, 40.8), kEverywhere, first_echo);
    const auto there = blobs(echo(60.3, 46.8), kEverywhere, first_echo);
    check(!here.empty() && !there.empty() && same(here[0], there[0], 9, 6), "moved with the image");
  }
}

void a_mirrored_image_mirrors_the_blob() {
  for (const bool first_echo : {false, true}) {
    const Image image = echo(51.3, 40.8);
    const auto one = blobs(image, kEverywhere, first_echo);
    const auto other = blobs(mirrored(image), kEverywhere, first_echo);
    check(!one.empty() && !other.empty() && same(one[0], other[0], kCols - 1 - 2 * one[0].u, 0), "mirrored");
    check(std::fabs(one[0].uv + other[0].uv) < 0.05 * one[0].uu, "and so does its shape");
  }
}

void what_the_mask_hides_means_nothing() {
  auto mask = kEverywhere;
  Image image = echo(51.3, 40.8), other = image;
  for (int r = 0; r < kRows; ++r)
    for (int c = 80; c < kCols; ++c) {
      mask[r * kCols + c] = 0;
      other[r * kCols + c] = static_cast<float>((r * 31 + c * 17) % 256);
    }
  const auto one = blobs(image, mask), two = blobs(other, mask);
  check(!one.empty() && one.size() == two.size(), "the same blobs");
  for (std::size_t i = 0; i < std::min(one.size(), two.size()); ++i) {
    check(one[i].u == two[i].u && one[i].v == two[i].v && one[i].score == two[i].score, "at the same places");
    check(mask[std::lround(two[i].v) * kCols + std::lround(two[i].u)] != 0, "and none behind the mask");
  }
  check(blobs(image, std::vector<unsigned char>(kRows * kCols, 0)).empty(), "nothing is seen through a mask");
}

void nothing_in_an_image_of_nothing() {
  for (const float grey : {0.f, 128.f, 255.f})
    check(blobs(Image(kRows * kCols, grey), kEverywhere).empty(), "a grey image has no blobs");
  const unsigned char seen[3] = {1, 1, 1};
  const float image[3] = {0, 255, 0};
  for (const auto& [rows, cols] : {std::pair(1, 1), std::pair(1, 3), std::pair(3, 1)})
    for (const int pool : {1, 2})
      check(BlobFilter(seen, rows, cols, {1, 2}, pool).detect(image, {}).size() <= 3, "the smallest images");
}

void a_paraboloid_has_its_top() {
  std::vector<EchoPixel> pixels;
  for (int v = 30; v < 50; ++v)
    for (int u = 40; u < 62; ++u) {
      const double x = u - 51.3, y = v - 40.8, value = 200 - x * x - 0.5 * x * y - 2 * y * y;
      if (value > 100) pixels.push_back({double(u), double(v), value});
    }
  const EchoFit fit = fit_echo(pixels, 200, 4);
  check(fit.found && std::hypot(fit.u - 51.3, fit.v - 40.8) < 1e-6, "the top of a paraboloid");
  check(!fit_echo({}, 200, 4).found && !fit_echo({12, {1, 1, 9}}, 200, 4).found, "none of one place");
}

void a_blur_keeps_what_there_is() {
  for (const double sigma : {0.8, 2.5, 6.0}) {
    Image image(kRows * kCols), scratch(kRows * kCols);
    image[48 * kCols + 60] = 1000;
    gaussian_blur(image, scratch, kRows, kCols, sigma);
    double sum = 0, square = 0;
    for (int r = 0; r < kRows; ++r)
      for (int c = 0; c < kCols; ++c) {
        sum += image[r * kCols + c];
        square += image[r * kCols + c] * (c - 60) * (c - 60);
      }
    check(std::fabs(sum - 1000) < 1, "the sum of a blurred image");
    check(std::fabs(std::sqrt(square / sum) - sigma) < 0.1 * sigma, "and the width that was asked for");
  }
}

}  // namespace

int main() {
  an_echo_is_found();
  a_moved_image_moves_the_blob();
  a_mirrored_image_mirrors_the_blob();
  what_the_mask_hides_means_nothing();
  nothing_in_an_image_of_nothing();
  a_paraboloid_has_its_top();
  a_blur_keeps_what_there_is();
  return summary("detections");
}
